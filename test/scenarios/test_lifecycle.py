# SPDX-License-Identifier: Apache-2.0
"""Managed nodes over real processes: every transition, what it refuses, and what it leaves."""

import numpy as np
import pytest
from thorough import mostly_thorough, thorough

pytest.importorskip('rclpy')

from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.node import NodeNameNonExistentError

from kalman_ros.codecs.messages import nanoseconds, write_stamp
from kalman_ros.harness import Run

#: What rclpy itself creates in every node.
OF_RCLPY = ('/rosout', '/parameter_events', '/diagnostics', '/clock')
SCENARIOS = {'microphone_array': 'sound_tracker'}
READINGS = {'/position', '/velocity'}
INNOVATIONS = {'/estimate/innovation/position', '/estimate/innovation/velocity'}
#: What each node subscribes to and publishes while it is active.
TOPICS = {
    'plant': ({'/disturbance', '/force'}, {'/ground_truth', *READINGS}),
    'estimator': (
        {'/force', '/initialpose', '/set_pose', *READINGS},
        {'/estimate', '/estimate/covariance', '/estimate/state', *INNOVATIONS},
    ),
    'controller': (
        {'/estimate', '/goal', '/reference', '/reference/path', '/reference/trajectory', '/stop'},
        {'/force'},
    ),
    'monitor': (
        {'/estimate', '/estimate/covariance', '/force', '/ground_truth', *INNOVATIONS, *READINGS},
        set(),
    ),
    'microphone_array': ({'/ground_truth'}, {'/bearing'}),
}


def alone(node, scenario='mass_spring_damper_2d', **parameters):
    return Run(scenario, lockstep=False, nodes=(node,), only={node: parameters})


def topics(run, node, direction):
    """Return the topics that the graph says a node subscribes to or publishes."""
    ask = getattr(run.node, f'get_{direction}_names_and_types_by_node')
    try:
        found = {name for name, _ in ask(node, '/')}
    except NodeNameNonExistentError:  # not yet
        return {'nothing of this node'}
    return {name for name in found if name not in OF_RCLPY and not name.startswith(f'/{node}/')}


def settles(run, node, direction, wanted):
    """Wait until the graph contains ``wanted``."""
    said = lambda: topics(run, node, direction)  # noqa: E731
    run.wait(lambda: said() == wanted, 60.0, lambda: f'{direction}: {said()}, not {wanted}')


@pytest.mark.parametrize(
    'node',
    mostly_thorough(
        ['plant', 'estimator', 'controller', 'monitor', 'microphone_array'],
        'controller',
    ),
)  # fmt: skip
def test_every_node_goes_through_every_state(node):
    with alone(node, SCENARIOS.get(node, 'mass_spring_damper_2d')) as run:
        assert run.state(node) == 'active'
        hears, says = TOPICS[node]
        # the graph learns a node's name and its topics by different messages
        settles(run, node, 'subscriber', hears)
        settles(run, node, 'publisher', says)
        for transition, state, heard, said in [
            ('deactivate', 'inactive', set(), says),
            ('activate', 'active', hears, says),
            ('deactivate', 'inactive', set(), says),
            ('cleanup', 'unconfigured', set(), set()),
            ('configure', 'inactive', set(), says),
            ('activate', 'active', hears, says),
            ('shutdown', 'finalized', set(), set()),
        ]:
            assert run.change_state(node, transition), transition
            assert run.state(node) == state
            settles(run, node, 'subscriber', heard)
            settles(run, node, 'publisher', said)
            if state != 'active':
                told = lambda: run.diagnostics[node].message  # noqa: E731
                run.wait(lambda: told() == state, 60.0, told)  # noqa: B023
        process = run.processes[node]
        process.signal(2)
        assert process.wait(10.0)
        assert process.exit_code == 0
        assert 'Traceback' not in process.output()
        run.processes.clear()


def test_a_transition_that_there_is_not_is_refused():
    with alone('estimator', autostart=False) as run:
        for transition in ('activate', 'cleanup', 'deactivate', 'dance'):
            assert not run.change_state('estimator', transition), transition
        for number in (Transition.TRANSITION_ACTIVATE, 99):
            request = ChangeState.Request(transition=Transition(id=number))
            assert not run.call(ChangeState, 'estimator/change_state', request).success
        assert run.state('estimator') == 'unconfigured'
        assert run.change_state('estimator', 'configure')
        assert not run.change_state('estimator', 'configure')
        assert run.state('estimator') == 'inactive'


@pytest.mark.parametrize(
    ('node', 'parameter', 'bad', 'good', 'says'),
    [
        thorough('plant', 'seed', 'one', 1, "seed: expected a whole number, got 'one'"),
        ('estimator', 'position.noise', [-1.0, 1.0], [0.1, 0.1], 'expected positive'),
        thorough('controller', 'input_limit', [1.0] * 3, 1.0, 'expected 1 or 2 numbers, got 3'),
        thorough('estimator', 'filter', 'kff', 'ekf', "unknown filter 'kff'"),
        thorough(
            'estimator', 'position.topic', '9 lives', 'place', 'expected the name of a topic'
        ),
        thorough('monitor', 'confidence', 2.0, 0.99, 'confidence: expected 0.5 to 1, got 2'),
    ],
)
def test_a_wrong_parameter_refuses_to_configure_and_can_be_put_right(
    node, parameter, bad, good, says
):
    with alone(node, {}, autostart=False) as run:
        run.set_parameter(parameter, bad, node)
        assert not run.change_state(node, 'configure')
        assert run.state(node) == 'unconfigured'
        told = lambda: run.diagnostics[node].message  # noqa: E731
        run.wait(lambda: told().startswith('unconfigured: ') and says in told(), 60.0, told)
        log = run.processes[node].output()
        assert says in log
        assert len(log.strip().splitlines()) == 1
        settles(run, node, 'publisher', set())
        run.set_parameter(parameter, good, node)
        assert run.change_state(node, 'configure')
        assert run.change_state(node, 'activate')
        assert run.state(node) == 'active'


def test_parameters_are_free_before_checked_while_and_kept_after_configuration():
    with alone('controller', {}, autostart=False) as run:
        run.set_parameter('nonsense', 1.0, 'controller')
        assert not run.change_state('controller', 'configure')
        log = run.processes['controller'].output
        assert "unknown parameter 'nonsense'" in log()
        # NOT_SET takes a parameter away, as `ros2 param delete` does
        run.set_parameter('nonsense', None, 'controller')
        assert run.change_state('controller', 'configure')
        for state in ('inactive', 'active'):
            with pytest.raises(ValueError, match="unknown parameter 'nonsense'"):
                run.set_parameter('nonsense', 1.0, 'controller')
            with pytest.raises(ValueError, match='input_cost: expected a positive def'):
                run.set_parameter('input_cost', [-1.0, 1.0], 'controller')
            with pytest.raises(ValueError, match='read-only'):
                run.set_parameter('model', 'cart_pole', 'controller')
            run.set_parameter('input_cost', [100, 100 if state == 'active' else 50], 'controller')
            assert run.change_state('controller', 'activate') == (state == 'inactive')
        for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
            assert run.change_state('controller', transition)
            request = GetParameters.Request(names=['input_cost'])
            (cost,) = run.call(GetParameters, 'controller/get_parameters', request).values
            assert [*cost.double_array_value, *cost.integer_array_value] == [100, 100], transition
        for transition in ('deactivate', 'cleanup'):
            assert run.change_state('controller', transition)
        with pytest.raises(ValueError, match='model: it names code'):
            run.set_parameter('model', 'mass_spring_damper', 'controller')
        run.set_parameter('law', 'lqt', 'controller')
        assert not run.change_state('controller', 'configure')  # there is no such law
        run.set_parameter('law', 'lqr', 'controller')
        assert run.change_state('controller', 'configure')


def velocity(stamp, value):
    message = TwistWithCovarianceStamped()
    write_stamp(message.header.stamp, stamp)
    message.twist.twist.linear.x = value
    message.twist.covariance[0] = message.twist.covariance[7] = 0.01
    return message


@pytest.mark.real_time
def test_nothing_that_came_meanwhile_is_replayed():
    with alone('estimator', rest_until_input=False) as run:
        estimates = []
        run.node.create_subscription(Odometry, 'estimate', estimates.append, 100)
        publisher = run.node.create_publisher(TwistWithCovarianceStamped, 'velocity', 100)
        hears = publisher.get_subscription_count
        now = lambda: run.node.get_clock().now().nanoseconds  # noqa: E731
        heard = lambda: int(run.reported('estimator', 'subscribers: /estimate') or 0)  # noqa: E731

        def answered(value):
            # a node and the recorder, both ways
            run.wait(lambda: hears() == 2 and heard() >= 2, 60.0, lambda: 'not connected')
            del estimates[:]
            stamp = now()
            publisher.publish(velocity(stamp, value))
            run.wait(lambda: estimates, 60.0, lambda: 'no estimate')
            assert nanoseconds(estimates[0].header.stamp) == stamp
            return estimates[0]

        before = answered(0.5)
        assert run.change_state('estimator', 'deactivate')
        run.wait(lambda: hears() == 1, 60.0, lambda: 'it still listens')
        for _ in range(50):
            publisher.publish(velocity(now(), 100.0))
        del estimates[:]
        assert run.change_state('estimator', 'activate')
        after = answered(0.5)
        assert len(estimates) == 1
        # the same belief as at the start, and the same reading
        assert after.twist == before.twist
        readings = lambda: run.reported('estimator', 'velocity: readings')  # noqa: E731
        run.wait(lambda: readings() == '2', 60.0, readings)


@pytest.mark.real_time
@pytest.mark.parametrize('limit', [np.inf, 20.0])
def test_the_controller_commands_zero_before_it_stops_publishing(limit):
    """However it goes: deactivated, shut down or interrupted."""
    with alone('controller', input_rate_limit=[limit], transition_time=0.0) as run:
        forces, times = [], []

        def on_force(message):
            forces.append(message.wrench.force.x)
            times.append(nanoseconds(message.header.stamp) * 1e-9)

        publisher = run.node.create_publisher(Odometry, 'estimate', 10)
        run.node.create_subscription(WrenchStamped, 'force', on_force, 1000)
        hears = publisher.get_subscription_count
        heard = lambda: int(run.reported('controller', 'subscribers: /force') or 0)  # noqa: E731

        def push():
            """Ask for a force, until it is large."""
            # a node and the recorder, both ways
            run.wait(lambda: hears() == 2 and heard() >= 2, 60.0, lambda: 'not connected')
            message = Odometry()
            message.pose.pose.position.x = 1.0
            for _ in range(100):
                now = run.node.get_clock().now().nanoseconds
                write_stamp(message.header.stamp, now)
                publisher.publish(message)
                run.spin(0.01)
                if forces and forces[-1] < -2.0:
                    break
            assert forces[-1] < -2.0

        def is_quiet(end):
            push()
            at = len(forces)
            end()
            run.spin(0.1)
            assert forces[-1] == 0.0
            steps = np.diff(forces[at - 1 :])
            assert np.all(steps >= 0.0)
            # stamps of the way to zero are those of the clock
            assert np.all(steps <= limit * np.diff(times[at - 1 :]) + 1e-5)
            count = len(forces)
            run.spin(0.3)
            assert len(forces) == count

        for transition, back in [('deactivate', 'activate'), ('shutdown', '')]:
            is_quiet(lambda: run.change_state('controller', transition))  # noqa: B023
            if back:
                assert run.change_state('controller', back)
        run.kill('controller', 2)
        run.start('controller')
        is_quiet(lambda: run.kill('controller', 15))


@pytest.mark.real_time
def test_an_inactive_plant_stands_still_and_goes_on():
    with Run(lockstep=False) as run:
        run.advance(0.5)
        run.set_parameter('run_until', 1e6)
        assert run.change_state('plant', 'deactivate')
        run.spin(0.2)
        raw = run.recorder.raw['ground_truth']
        count, last = len(raw), run.recorder['ground_truth'].values[-1]
        run.spin(0.3)
        assert len(raw) == count
        assert run.change_state('plant', 'activate')
        run.wait(lambda: len(raw) > count + 50, 60.0, lambda: 'the plant stands still')
        truth = run.recorder['ground_truth']
        np.testing.assert_allclose(truth.values[count], last, atol=0.1)
        gap = truth.stamp[count] - truth.stamp[count - 1]
        assert gap > 0.4e9  # stamps are the time, not the time that the plant has been active
        running = lambda: run.diagnostics['plant'].message == 'running'  # noqa: E731
        run.wait(running, 60.0, lambda: run.diagnostics['plant'].message)


@pytest.mark.real_time
@pytest.mark.parametrize('node', ['estimator', 'controller'])
def test_the_loop_resumes_in_real_time(node):
    with Run(lockstep=False, overrides={'force_timeout': 0.3}) as run:
        run.advance(1.0)
        run.set_parameter('run_until', 1e6)
        said = lambda: run.diagnostics['plant'].message  # noqa: E731
        for _ in range(2):
            assert run.change_state(node, 'deactivate')
            if node == 'estimator':
                # the controller goes on to say zero
                zero = lambda: not run.recorder['force'].values[-1].any()  # noqa: E731
                run.wait(zero, 60.0, lambda: 'still a force')
                told = lambda: run.diagnostics['controller'].message  # noqa: E731
                run.wait(lambda: 'received for' in told(), 60.0, told)  # noqa: B023
            else:
                run.wait(lambda: said() == 'no force received: it is zero', 60.0, said)
            assert run.change_state(node, 'activate')
            count = len(run.recorder.raw['force'])
            some = lambda: run.recorder['force'].values[count:].any()  # noqa: B023, E731
            run.wait(some, 60.0, lambda: 'no force again')
            run.wait(lambda: said() == 'running', 60.0, said)
        assert np.isfinite(run.recorder['estimate'].values).all()
        assert np.isfinite(run.recorder['force'].values).all()


@pytest.mark.thorough
@pytest.mark.parametrize(
    'node', mostly_thorough(['plant', 'estimator', 'controller', 'monitor'], 'estimator')
)
def test_the_loop_resumes_in_lockstep(node):
    with Run(overrides={'lockstep_timeout': 0.4}) as run:
        run.advance(0.5)
        assert run.change_state(node, 'deactivate')
        run.set_parameter('run_until', 1.0)
        run.spin(0.5)
        assert run.change_state(node, 'activate')
        stands = lambda: f'lockstep stands at {run.elapsed}'  # noqa: E731
        run.wait(lambda: run.elapsed > 0.995, 20.0, stands)
        run.complete()
        found = run.trajectory()
    assert len(found.time) == 101
    assert np.abs(found.truth[-1]).max() < 1.5


@pytest.mark.thorough
def test_nodes_wait_to_be_asked():
    """``autostart:=false`` on all: brought up in any order, the loop closes."""
    with Run(lockstep=False, overrides={'autostart': False}) as run:
        names = list(run.processes)
        assert [run.state(name) for name in names] == ['unconfigured'] * 4
        assert len(run.recorder.raw['ground_truth']) == 0
        for transition in ('configure', 'activate'):
            for name in names:
                assert run.change_state(name, transition), name
        run.set_parameter('run_until', 1e6)
        said = lambda: run.diagnostics['plant'].message  # noqa: E731
        run.wait(lambda: said() == 'running', 60.0, said)
