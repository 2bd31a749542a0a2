# SPDX-License-Identifier: Apache-2.0
"""What a person changes on a live page: ranges, refusals, and the file that is shared."""

import json

import numpy as np
import pytest
import yaml

from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.controls import controls
from kalman_ros.live.live_theory import theory
from kalman_ros.live.scene import scene
from kalman_ros.live.share import parameter_file
from kalman_ros.scenario import shipped


def opened(name='mass_spring_damper'):
    return Adjustments(shipped.file(name), {})


@pytest.mark.parametrize('name', shipped.names())
def test_every_scenario_has_a_scene_with_values_inside_its_sliders(name):
    found = opened(name)
    sliders = controls(found)
    json.dumps(scene(found, sliders), allow_nan=False)
    for control in sliders.values():
        value = control.read(found)
        if control.low is None:
            assert isinstance(value, bool)
        else:
            assert control.low <= value <= control.high, control.key
            assert control.low < control.high, control.key
            assert control.scale == 'linear' or control.low > 0.0, control.key


def test_actual_and_believed_noise_are_separate():
    found = opened()
    sliders = controls(found)
    control = sliders['estimator/position.noise/0']
    found.change('estimator', {control.parameter: control.value_of(0.5, found)})
    assert found.scenario('estimator').sensors['position'].sensor.covariance[0, 0] == 0.25
    assert found.scenario('plant').sensors['position'].sensor.covariance[0, 0] == 0.05**2
    # or the estimator would use the noise in the messages
    assert found.scenario('estimator').sensors['position'].covariance_from == 'configuration'


@pytest.mark.parametrize('value', [None, 'x', True, float('nan'), float('inf'), [1.0], {}])
def test_a_slider_takes_finite_numbers_only(value):
    found = opened()
    control = controls(found)['controller/state_cost/0']
    with pytest.raises(ValueError, match='state_cost: expected a finite number, got'):
        control.value_of(value, found)


def test_a_switch_takes_truth_values_only():
    found = opened()
    control = controls(found)['plant/position.enabled']
    assert control.value_of(False, found) is False
    with pytest.raises(ValueError, match=r'position\.enabled: expected true or false, got 1'):
        control.value_of(1, found)


def test_a_refused_change_leaves_all_as_it_was():
    found = opened('cart_pole')
    before = parameter_file(found)
    for node, values in (
        ('estimator', {'filter': 'kf'}),  # the cart-pole is not linear
        ('estimator', {'filter': 'nonsense'}),
        ('controller', {'state_cost': [-1.0, 0.0, 0.0, 0.0]}),
        ('controller', {'law': 'placement', 'regulator_poles': [-1.0] * 9}),
        ('plant', {'joint_states.noise': [0.1, 0.1, 0.1]}),
    ):
        with pytest.raises(ValueError):
            found.change(node, values)
    assert parameter_file(found) == before


@pytest.mark.parametrize('name', shipped.names())
def test_the_shared_file_is_the_same_scenario(name, tmp_path):
    found = opened(name)
    found.change('plant', {f'{found.sensors[0]}.dropout': 0.25})
    file = tmp_path / 'shared.yaml'
    file.write_text(parameter_file(found))
    again = Adjustments(file, {})
    for node in ('plant', 'estimator', *(['controller'] if found.driven else [])):
        for key in found.known(node):
            assert again.value(node, key) == found.value(node, key), (node, key)
    assert yaml.safe_load(file.read_text())['plant']['ros__parameters'][found.sensors[0]]


def test_the_theory_follows_a_weight():
    found = opened()
    before = theory(found.believed(), found.scenario('plant'), 0.0)
    found.change('controller', {'state_cost': [2000.0, 2.0]})
    after = theory(found.believed(), found.scenario('plant'), 0.0)
    assert max(np.hypot(*np.transpose(after['regulator']['poles']))) > 2.0 * max(
        np.hypot(*np.transpose(before['regulator']['poles']))
    )
    assert after['estimator'] == before['estimator']
    assert after['open'] == before['open'] and after['notes'] == []


def test_the_theory_of_an_observer_has_its_poles():
    found = opened('linear')
    found.change('estimator', {'filter': 'luenberger', 'observer_poles': [-3.0, -4.0]})
    observer = theory(found.believed(), found.scenario('plant'), 0.0)
    # x_hat' = (I - L T C) F x_hat with L = (7, 12), T = 1 / 20 s
    over = np.array([[0.65, 0.65 / 20.0], [-0.6, 1.0 - 0.6 / 20.0]])
    exact = np.sort(20.0 * np.log(np.linalg.eigvals(over)))[::-1]
    np.testing.assert_allclose([p[0] for p in observer['estimator']['poles']], exact, rtol=1e-5)


def test_a_tracker_without_a_steady_state_has_a_note_instead():
    found = opened('constant_velocity')
    estimator = found.scenario('estimator')
    notes = theory(estimator, found.scenario('plant'), 0.0)['notes']
    assert any('no steady state' in note for note in notes)


def test_a_law_without_the_limits_of_the_file_is_set_after_the_start(tmp_path):
    file = tmp_path / 'track.yaml'
    text = shipped.file('cart_pole').read_text()
    section = {'law': 'mpc', 'state_limit.x': [-1.0, 1.0]}
    written = yaml.safe_load(text)
    written.setdefault('controller', {}).setdefault('ros__parameters', {}).update(section)
    file.write_text(yaml.safe_dump(written))
    found = Adjustments(file, {})
    found.change('controller', {'law': 'lqr', 'input_limit': [5.0]})
    assert found.at_start('controller') == {'input_limit': [5.0]}
    assert 'state_limit.x' not in found.given('controller')
    found.change('controller', {'law': 'mpc'})
    assert found.at_start('controller') == {'law': 'mpc', 'input_limit': [5.0]}
