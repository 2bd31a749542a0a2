# SPDX-License-Identifier: Apache-2.0
"""A request to set parameters is one change, however many parameters it names."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from kalman_ros.nodes.controller.node import ControllerNode


@pytest.fixture
def ask(pair, monkeypatch):
    """Return a function that sends a request, and the changes that were prepared for it."""
    started = pair(ControllerNode)
    prepared, prepare = [], started.node.prepare
    monkeypatch.setattr(
        started.node, 'prepare', lambda *given: prepared.append(given) or prepare(*given)
    )
    client = started.peer.create_client(SetParameters, 'controller/set_parameters')
    started.until(client.service_is_ready, 'there is no service')
    started._executor.add_node(started.peer)

    def send(*settings):
        messages = [Parameter(name, value=value).to_parameter_msg() for name, value in settings]
        answer = client.call_async(SetParameters.Request(parameters=messages))
        started.until(answer.done, 'no answer')
        return [(each.successful, each.reason) for each in answer.result().results]

    return send, prepared, started.node


@pytest.mark.slow
def test_a_name_that_is_repeated_is_refused_without_any_work(ask):
    send, prepared, node = ask
    before = list(node.get_parameter('input_cost').value)
    answers = send(*[('input_cost', [1.0 + k, 1.0]) for k in range(1000)], ('input_limit', [9.0]))
    assert answers[:-1] == [(False, 'input_cost: expected once, got 1000 times')] * 1000
    assert answers[-1] == (True, '')
    assert len(prepared) == 1
    assert list(node.get_parameter('input_cost').value) == before
    assert list(node.get_parameter('input_limit').value) == [9.0]


def test_what_is_wrong_is_named_and_the_rest_is_one_change(ask):
    send, prepared, node = ask
    answers = send(
        ('input_cost', [2.0, 3.0]),
        ('imput_cost', [2.0, 3.0]),
        ('estimate_timeout', 'soon'),
        ('rate', 50.0),
        ('input_limit', [7]),
    )
    assert [successful for successful, _ in answers] == [True, False, False, False, True]
    assert "did you mean 'input_cost'" in answers[1][1]
    assert answers[2][1].startswith('estimate_timeout: expected a number')
    assert answers[3][1] == 'rate: it is read-only'
    assert len(prepared) == 1
    assert list(node.get_parameter('input_cost').value) == [2.0, 3.0]
    assert list(node.get_parameter('input_limit').value) == [7.0]


@pytest.mark.parametrize('kind', [SetParameters, SetParametersAtomically])
def test_a_type_that_does_not_exist_is_refused(pair, kind):
    started = pair(ControllerNode)
    started._executor.add_node(started.peer)
    name = 'set_parameters' if kind is SetParameters else 'set_parameters_atomically'
    client = started.peer.create_client(kind, f'controller/{name}')
    started.until(client.service_is_ready, 'there is no service')
    hostile = ParameterMessage(name='input_cost', value=ParameterValue(type=200))
    answer = client.call_async(kind.Request(parameters=[hostile]))
    started.until(answer.done, 'no answer')
    found = answer.result()
    for result in [found.result] if hasattr(found, 'result') else found.results:
        assert not result.successful
        assert '200 is not a valid' in result.reason


def test_what_is_refused_together_stays_as_it_was(ask):
    send, _, node = ask
    before = list(node.get_parameter('input_cost').value)
    answers = send(('input_cost', [2.0, -3.0]), ('input_limit', [7.0]))
    assert [successful for successful, _ in answers] == [False, False]
    assert answers[0] == answers[1]
    assert list(node.get_parameter('input_cost').value) == before


def laws(node):
    """Return the law of a controller, and which parameters of laws it has."""
    names = ('regulator_poles', 'horizon', 'state_limit.v_x', 'tracked')
    return node.get_parameter('law').value, [name for name in names if node.has_parameter(name)]


def test_the_law_is_changed_with_its_parameters(ask):
    send, prepared, node = ask
    assert send(('law', 'mpc')) == [(True, '')]
    assert laws(node) == ('mpc', ['horizon', 'state_limit.v_x'])
    assert send(('state_limit.v_x', [-1.0, 1.0])) == [(True, '')]
    assert node.scenario.law_options['state_limit.v_x'] == [-1.0, 1.0]
    assert send(('law', 'lqr')) == [(True, '')]
    assert laws(node) == ('lqr', [])
    assert 'state_limit.v_x' not in node.scenario.law_options
    assert send(('law', 'mpc')) == [(True, '')]
    assert list(node.get_parameter('state_limit.v_x').value) == [-1.0, 1.0]  # as it was
    assert node.scenario.law_options['state_limit.v_x'] == [-1.0, 1.0]
    assert send(('law', 'mcp'), ('input_limit', [5.0])) == [(False, prepared_reason(node))] * 2
    assert laws(node)[0] == 'mpc'
    assert len(prepared) == 4  # none for what is refused


def prepared_reason(node):
    result = node.set_parameters_atomically([Parameter('law', value='mcp')])
    assert not result.successful and "did you mean 'mpc'" in result.reason
    return result.reason


def test_a_law_is_chosen_together_with_what_only_it_has(pair):
    node = pair(ControllerNode).node
    poles = Parameter('regulator_poles', value=[-2.0, -3.0])

    def choose(*others):
        return node.set_parameters_atomically([Parameter('law', value='placement'), *others])

    assert not node.set_parameters_atomically([poles]).successful
    refused = choose(Parameter('regulator_poles', value=[2.0, -3.0]))
    assert not refused.successful and 'regulator_poles' in refused.reason
    assert 'no_such' in choose(Parameter('no_such', value=1.0)).reason
    assert laws(node) == ('lqr', [])
    assert choose(poles).successful
    assert laws(node) == ('placement', ['regulator_poles'])
    assert list(node.get_parameter('regulator_poles').value) == [-2.0, -3.0]


def test_a_changed_law_is_that_of_the_next_configuration(pair):
    node = pair(ControllerNode).node
    node.set_parameters_atomically([Parameter('law', value='mpc')])
    node.set_parameters_atomically([Parameter('state_limit.v_x', value=[-1.0, 1.0])])
    node.set_parameters_atomically([Parameter('law', value='lqi')])
    for transition in (node.trigger_deactivate, node.trigger_cleanup):
        transition()
    node.trigger_configure()
    assert laws(node) == ('lqi', ['tracked'])


def test_limits_of_the_start_are_set_aside_by_a_law_without_them(pair):
    node = pair(ControllerNode, **{'law': 'mpc', 'state_limit.v_x': '[-1.0, 1.0]'}).node
    for law, known in (('lqr', []), ('mpc', ['horizon', 'state_limit.v_x'])):
        assert node.set_parameters_atomically([Parameter('law', value=law)]).successful
        assert laws(node) == (law, known)
    assert list(node.get_parameter('state_limit.v_x').value) == [-1.0, 1.0]


@pytest.mark.slow
def test_a_law_without_the_limits_of_the_start_can_be_configured_again(pair):
    node = pair(ControllerNode, **{'law': 'mpc', 'state_limit.v_x': '[-1.0, 1.0]'}).node
    assert node.set_parameters_atomically([Parameter('law', value='lqr')]).successful
    for transition in ('deactivate', 'cleanup', 'configure'):
        getattr(node, f'trigger_{transition}')()
    assert laws(node) == ('lqr', [])
