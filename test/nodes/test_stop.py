# SPDX-License-Identifier: Apache-2.0
"""Every arrow between running, disabled and stopped, in the controller node."""

from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool, Trigger

from kalman_ros.core import OperatingPoint
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.controller.stop import Heartbeat, Stop
from kalman_ros.nodes.middleware.connections import Connections

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.mark.parametrize(
    ('moves', 'acts'),
    [
        ('', True),
        ('disable', False),
        ('disable enable', True),
        ('stop', False),
        ('stop enable', False),
        ('stop reset', False),
        ('stop reset enable', True),
        ('stop enable reset', False),
        ('stop disable reset enable', True),
        ('stop stop reset enable', True),
        ('reset', True),
        ('disable reset', False),
        ('disable stop enable', False),
        ('press reset enable', False),
        ('press release', False),
        ('press release enable', False),
        ('press release reset enable', True),
        ('stop press reset release enable', False),
        ('release', True),
    ],
)
def test_only_a_reset_and_then_an_enable_end_a_stop(moves, acts):
    switch = Stop(enabled=True)
    do = {
        'enable': lambda: switch.enable(on=True),
        'disable': lambda: switch.enable(on=False),
        'stop': lambda: switch.stop('a reason'),
        'reset': switch.reset,
        'press': lambda: switch.press('a button', on=True),
        'release': lambda: switch.press('a button', on=False),
    }
    for move in moves.split():
        do[move]()
    assert switch.may_act is acts


def test_the_first_reason_stays():
    switch = Stop(enabled=True)
    switch.stop('first')
    switch.stop('second')
    assert switch.reason == 'first'
    assert not switch.enable(on=True)
    assert switch.enable(on=False)


def test_a_heartbeat_is_late_beyond_its_timeout_alone(monkeypatch):
    now = [100.0]
    monkeypatch.setattr('kalman_ros.nodes.controller.stop.monotonic', lambda: now[0])
    beats, none = Heartbeat(0.5), Heartbeat(0.0)
    now[0] = 100.5
    assert not beats.problem
    now[0] = 100.501
    assert beats.problem == 'no heartbeat for 0.5 s'
    assert not none.problem
    beats.beat()
    assert not beats.problem


def ask(node, service, kind, **fields):
    """Return the answer of a service of the node, by its callback."""
    callbacks = {'enable': node._on_enable, 'stop': node._on_stop_request, 'reset': node._on_reset}
    return callbacks[service](kind.Request(**fields), kind.Response())


def level(node):
    return node.report()[1]


def test_the_service_stops_and_says_what_ends_it(pair):
    node = pair(ControllerNode).node
    assert ask(node, 'stop', Trigger).success
    assert level(node).startswith('stopped (~/stop): the force is zero')
    assert node._output.closed
    refused = ask(node, 'enable', SetBool, data=True)
    assert not refused.success
    assert refused.message == 'stopped (~/stop): call ~/reset first'
    page = (Path(__file__).parents[2] / 'docs' / 'how_to' / 'stop.md').read_text()
    assert f"... success={refused.success}, message='{refused.message}'\n" in page
    assert ask(node, 'reset', Trigger).message == 'not stopped; ~/enable lets it act'
    assert node._output.closed
    assert level(node).startswith('disabled')
    assert ask(node, 'enable', SetBool, data=True).success
    assert not node._output.closed


@pytest.mark.parametrize('quality', [LATCHED, 10, BEST_EFFORT])
def test_the_topic_stops_from_any_publisher_and_false_does_not_end_it(pair, quality):
    started = pair(ControllerNode)
    publisher = started.peer.create_publisher(Bool, 'stop', quality)
    started.until(publisher.get_subscription_count, 'no subscriber of stop')
    found = Connections(started.node)._of_subscription('/stop', awaited=True)
    assert [*found] == []  # one of its subscriptions connects
    publisher.publish(Bool(data=False))
    publisher.publish(Bool(data=True))
    started.until(lambda: started.node._output.closed, 'not stopped')
    held = ask(started.node, 'reset', Trigger)
    assert not held.success
    assert held.message == 'the topic stop is true: publish false first'
    publisher.publish(Bool(data=False))
    started.until(lambda: not started.node._stop._pressed, 'not released')
    assert 'the topic stop' in level(started.node)
    assert not ask(started.node, 'enable', SetBool, data=True).success
    assert ask(started.node, 'reset', Trigger).success
    assert ask(started.node, 'enable', SetBool, data=True).success


def test_a_stop_from_before_the_start_counts(pair):
    started = pair(ControllerNode, autostart='false')
    publisher = started.peer.create_publisher(Bool, 'stop', LATCHED)
    publisher.publish(Bool(data=True))
    started.node.trigger_configure()
    started.node.trigger_activate()
    started.until(lambda: started.node._output.closed, 'not stopped')


@pytest.mark.parametrize(
    ('resume', 'state'), [('automatic', 'running'), ('enable', 'disabled'), ('never', 'stopped')]
)
def test_a_fault_ends_as_resume_says(pair, resume, state):
    node = pair(ControllerNode, resume=resume).node
    node._fail('a fault', 0)
    assert node._stop.may_act is (state == 'running')
    assert bool(node._stop.reason) is (state == 'stopped')
    allowed = ask(node, 'enable', SetBool, data=True).success
    assert allowed is (state != 'stopped')
    ask(node, 'reset', Trigger)
    assert ask(node, 'enable', SetBool, data=True).success


@pytest.mark.slow
def test_without_its_heartbeat_the_input_goes_to_idle(pair, monkeypatch):
    now = [100.0]
    monkeypatch.setattr('kalman_ros.nodes.controller.stop.monotonic', lambda: now[0])
    started = pair(ControllerNode, heartbeat_timeout=0.3)
    node = started.node
    beats = started.publisher(Empty, 'heartbeat')
    assert not node._heartbeat_problem()
    now[0] = 100.4
    started.until(lambda: 'no heartbeat' in level(node), 'no fault')
    beats.publish(Empty())
    started.until(lambda: not node._heartbeat_problem(), 'not heard')


def test_a_motion_ends_with_a_stop_and_waits_while_disabled(pair):
    from kalman_ros.scenario.motions import motion_of
    from kalman_ros.scenario.reference_motions import along_path

    node = pair(ControllerNode).node
    scenario = node.scenario
    path = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    import numpy as np

    motion = motion_of(scenario, along_path(scenario, np.array(path), 0.5, 0.5))
    node._regulator.follow_motion(motion)
    ask(node, 'enable', SetBool, data=False)
    assert node._regulator.motion is motion
    ask(node, 'stop', Trigger)
    assert node._regulator.motion is None
    np.testing.assert_allclose(node._regulator.target[0][[1, 3]], 0.0, atol=1e-9)


def test_the_input_goes_on_from_idle_after_a_stop_without_an_estimate_between(pair):
    node = pair(ControllerNode, transition_time=0.5).node
    x = node.scenario.model.equilibrium.state + 1.0
    node._regulator.follow(x, node._output.value + 3.0)
    ask(node, 'stop', Trigger)
    ask(node, 'reset', Trigger)
    ask(node, 'enable', SetBool, data=True)
    node._recover(x)
    assert not node._regulator.propose(x, 0.0).any()


def test_what_is_asked_for_while_it_is_stopped_is_forgotten(pair):
    node = pair(ControllerNode).node
    state, input = node.scenario.model.equilibrium
    before = node._regulator.target[0].copy()
    ask(node, 'stop', Trigger)
    node._hold(OperatingPoint(state + 0.5, input))
    ask(node, 'reset', Trigger)
    ask(node, 'enable', SetBool, data=True)
    assert (node._regulator.target[0] == before).all()
    node._hold(OperatingPoint(state + 0.5, input))
    assert (node._regulator.target[0] == state + 0.5).all()


def test_a_set_point_ends_what_is_planned(pair):
    node = pair(ControllerNode).node
    node._motions._wanted = lambda: None
    node._hold(node.scenario.model.equilibrium)
    assert node._motions._wanted is None


def test_new_gains_do_not_replace_a_motion_that_is_being_planned(pair):
    node = pair(ControllerNode).node
    reader, started = node._motions, []
    reader._jobs.start = started.append
    reader.regain(type('Motion', (), {'states': 0})(), node.scenario)
    assert len(started) == 1
    reader._wanted = lambda: None
    reader.regain(type('Motion', (), {'states': 0})(), node.scenario)
    assert len(started) == 1
    from dataclasses import replace

    from kalman_ros.control.limiter import Limits

    free = Limits.none(node.scenario.model.input.size)
    other = replace(node.scenario)
    reader.adopt(other, node.options, free)  # planned again, with new weights
    assert len(started) == 2
    reader.adopt(other, node.options, free)  # nothing of it has changed
    assert len(started) == 2


def test_a_trajectory_that_begins_later_begins_at_what_is_held(pair):
    from builtin_interfaces.msg import Duration
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    node = pair(ControllerNode).node
    point = JointTrajectoryPoint(positions=[1.0], time_from_start=Duration(sec=2))
    node._regulator.hold(node.scenario.model.equilibrium.state + 0.25, node._output.value)
    message = JointTrajectory(joint_names=['x'], points=[point])
    reference = node._motions._trajectory('reference/trajectory', message).reference(None)
    assert reference.values[0, 0] == pytest.approx(0.25)
    assert reference.values[-1, 0] == pytest.approx(1.0)
    assert len(reference.values) == 201


@pytest.mark.slow
def test_gains_that_are_ready_after_the_end_of_a_motion_do_not_start_it_again(pair):
    import numpy as np

    from kalman_ros.scenario.motions import motion_of
    from kalman_ros.scenario.reference_motions import along_path

    node = pair(ControllerNode).node
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    motion = motion_of(node.scenario, along_path(node.scenario, path, 0.5, 0.5))
    node._regulator.follow_motion(motion)
    node._regulator.propose(motion.states[0], 0.1)
    node._regulator.propose(motion.states[0], 0.1)
    node._motions.regain(motion, node.scenario)
    again, since = taken(node)
    assert again.states is motion.states
    assert since == 0.0 and node._regulator.elapsed == pytest.approx(0.1)
    node._motions.regain(motion, node.scenario)
    node._hold(node.scenario.model.equilibrium)
    assert taken(node, seconds=0.5) is None


def taken(node, seconds=60.0):
    """Return what is planned, or None after some seconds."""
    from time import monotonic, sleep

    end = monotonic() + seconds
    while monotonic() < end:
        planned = node._motions.take()
        if planned is not None:
            return planned
        sleep(0.01)
    return None


def test_a_path_is_planned_with_the_options_of_the_planning(pair):
    from dataclasses import replace

    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Path

    from kalman_ros.control.limiter import Limits

    node = pair(ControllerNode).node
    message = Path(poses=[PoseStamped(), PoseStamped()])
    message.poses[1].pose.position.x = 1.0
    wanted = node._motions._path('reference/path', message)
    slow = len(wanted.reference(None).values)
    faster = replace(node.options, path_speed=2.0, path_acceleration=4.0)
    node._motions.adopt(node.scenario, faster, Limits.none(node.scenario.model.input.size))
    assert len(wanted.reference(None).values) < 0.6 * slow


def test_what_is_planned_while_it_does_not_act_is_planned_again_from_where_it_is(pair):
    from time import sleep

    import numpy as np
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Path

    node = pair(ControllerNode).node
    message = Path(poses=[PoseStamped(), PoseStamped()])
    message.poses[1].pose.position.x = 1.0
    reader = node._motions
    reader._here = lambda: here
    here = np.zeros(node.scenario.model.state.size)
    reader.plan(reader._path('reference/path', message))
    for _ in range(1000):
        reader.poll(acts=False)
        if reader._planned is not None:
            break
        sleep(0.01)
    reader.poll(acts=False)
    here = here + 0.5
    motion, since = taken(node)
    assert since is None
    np.testing.assert_allclose(motion.states[0], here)


def test_a_path_beyond_the_limits_of_states_is_followed_more_slowly(pair):
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Path

    node = pair(ControllerNode, law='mpc', **{'state_limit.v_x': [-0.1, 0.1]}).node
    reader = node._motions
    message = Path(poses=[PoseStamped(), PoseStamped()])
    message.poses[1].pose.position.x = 1.0
    reader.plan(reader._path('reference/path', message))
    motion = taken(node).motion
    speed = motion.states[:, node.scenario.model.state.names.index('v_x')]
    assert 0.09 < speed.max() <= 0.102
    # one with times is not slower than these
    message.poses[1].header.stamp.sec = 2
    reader.plan(reader._path('reference/path', message))
    assert taken(node, 5.0) is None
    assert 'v_x is ' in reader.refusal and 'beyond its state_limit of 0.1' in reader.refusal
