# SPDX-License-Identifier: Apache-2.0
"""What the estimator does with readings that waited, and with changes while it runs."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from kalman_ros.codecs.messages import nanoseconds, write_stamp
from kalman_ros.estimators.instants import Instants
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.smoother import smooth
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.middleware.connections import Connections
from kalman_ros.nodes.middleware.diagnostics import Level
from kalman_ros.pipeline.reading import Reading

STEP = 10_000_000


def send(publisher, stamps):
    message = TwistWithCovarianceStamped()
    message.twist.covariance[:] = np.eye(6).ravel()
    for stamp in stamps:
        write_stamp(message.header.stamp, stamp)
        publisher.publish(message)


def record(pair, monkeypatch):
    """Return the stamps of the estimates that are published from now on."""
    publisher = pair.node._estimates._publisher
    stamps, publish = [], publisher.publish

    def publish_and_note(message):
        found = message
        if isinstance(message, bytes):
            found = deserialize_message(message, publisher.msg_type)
        stamps.append(nanoseconds(found.header.stamp))
        publish(message)

    monkeypatch.setattr(publisher, 'publish', publish_and_note)
    return stamps


def test_readings_that_waited_in_the_wrong_order_are_each_computed_once(pair, monkeypatch):
    """Each late one would repeat all those after it."""
    found = pair(EstimatorNode)
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    online, computed = found.node._online, []
    process = online._process
    monkeypatch.setattr(
        online, '_process', lambda item, state: computed.append(item) or process(item, state)
    )
    first = found.node.get_clock().now().nanoseconds - 20 * STEP
    send(velocity, [first + k * STEP for k in reversed(range(20))])
    counts = online.counts['velocity']
    found.until(lambda: counts.total() == 20, 'not all readings came')
    assert counts == {Outcome.FUSED: 20}
    assert online.time == first + 19 * STEP
    # what wakes the node is the first to be taken, the others may come just after
    assert len(computed) < 3 * 20, len(computed)


def test_after_a_reset_the_readings_used_before_are_not_reported_as_unusable(pair):
    found = pair(EstimatorNode, rest_until_input='false')
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    assert found.node.report()[1] == 'no readings received'
    send(velocity, [found.node.get_clock().now().nanoseconds])
    found.until(lambda: found.node._online.time is not None, 'no reading came')
    assert found.node.report()[2]['resets'] == 0
    found.node._on_reset(None, Trigger.Response())
    assert found.node.report()[2]['resets'] == 1
    wanted = 'no reading could be used since the last reset; in total: 1 of velocity fused'
    assert found.node.report()[1] == wanted


def test_readings_without_stamps_are_taken_at_the_time_of_their_arrival(pair):
    found = pair(
        EstimatorNode, model='level', rest_until_input='false',
        **{'reading.type': 'std_msgs/Float64', 'reading.fields': "['data']"},
    )  # fmt: skip
    topic = found.node.scenario.sensors['reading'].signal.topic
    publisher, counts = found.publisher(Float64, topic), found.node._online.counts['reading']
    before = found.node.get_clock().now().nanoseconds
    publisher.publish(Float64(data=1.0))
    found.until(lambda: counts[Outcome.FUSED] == 1, 'the reading is not fused')
    assert before < found.node._online.time <= found.node.get_clock().now().nanoseconds


def test_the_topics_of_ros_are_not_counted_among_those_of_the_node(pair):
    found = pair(EstimatorNode)
    found.until(lambda: found.node.diagnostics._connections, 'nothing is counted')
    keys = found.node.diagnostics._connections
    assert keys['publishers: /velocity'] == keys['subscribers: /estimate'] == 0
    assert not any(key.endswith(('/rosout', '/parameter_events', '/diagnostics')) for key in keys)


def test_fusion_is_switched_off_and_on_and_each_reading_is_counted(pair, monkeypatch):
    found = pair(EstimatorNode, rest_until_input='false')
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    force = found.publisher(WrenchStamped, 'force')
    counts, inputs = found.node._online.counts['velocity'], found.node._fuser.inputs
    estimates = record(found, monkeypatch)

    def toggle(data):
        return found.node._on_toggle(SetBool.Request(data=data), SetBool.Response())

    first = found.node.get_clock().now().nanoseconds
    send(velocity, [first])
    found.until(lambda: counts[Outcome.FUSED] == 1, 'no reading came')
    assert toggle(False).message == 'readings are not fused'
    before = found.node._online.time, found.node._online.belief.mean.tolist()
    send(velocity, [first + STEP, first + 2 * STEP])
    found.until(lambda: counts[Outcome.SWITCHED_OFF] == 2, 'the readings are not counted')
    assert (found.node._online.time, found.node._online.belief.mean.tolist()) == before
    assert len(estimates) == 1
    level, words, _ = found.node.report()
    assert level is Level.WARN and words == 'fusion is switched off by ~/toggle'
    message = WrenchStamped()
    write_stamp(message.header.stamp, first + 3 * STEP)
    force.publish(message)  # inputs are kept: the plant obeys them
    found.until(lambda: inputs[Outcome.FUSED] == 1, 'the input is not used')
    assert toggle(True).success
    send(velocity, [first + 4 * STEP])
    found.until(lambda: counts[Outcome.FUSED] == 2, 'the reading is not fused')
    assert 'switched off' not in found.node.report()[1]
    toggle(False)
    found.node.trigger_deactivate()
    found.node.trigger_activate()
    assert found.node._fuser.fusing


def test_the_first_belief_is_set_while_inactive_and_counts_from_the_next_start(pair):
    found = pair(EstimatorNode, rest_until_input='false')
    node = found.node
    node.trigger_deactivate()
    mean, std = [1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 0.3, 0.4]
    answers = node.set_parameters(
        [Parameter('initial_estimate', value=mean), Parameter('initial_std', value=std)]
    )
    assert all(each.successful for each in answers), answers
    node.trigger_activate()
    belief = node._online.belief
    np.testing.assert_array_equal(belief.mean, mean)
    np.testing.assert_allclose(belief.covariance, np.diag(np.square(std)))
    # an active one goes on, until it is reset
    (answer,) = node.set_parameters([Parameter('initial_estimate', value=[9.0] * 4)])
    assert answer.successful
    np.testing.assert_array_equal(node._online.belief.mean, mean)
    node._on_reset(None, Trigger.Response())
    np.testing.assert_array_equal(node._online.belief.mean, [9.0] * 4)
    (answer,) = node.set_parameters([Parameter('initial_std', value=[-1.0] * 4)])
    assert not answer.successful
    # what is refused at a start is refused here
    (answer,) = node.set_parameters([Parameter('initial_estimate', value=[1e300] * 4)])
    assert not answer.successful
    assert list(node.get_parameter('initial_estimate').value) == [9.0] * 4


def test_a_second_publisher_of_an_output_is_named(pair):
    found = pair(EstimatorNode, rest_until_input='false')
    connections = Connections(found.node)
    assert [*connections._of_publisher('/estimate')] == []
    second = found.peer.create_publisher(Odometry, 'estimate', 10)
    wanted = ['/estimate: /peer publishes here, too']
    found.until(lambda: [*connections._of_publisher('/estimate')] == wanted, 'not named')
    found.peer.destroy_publisher(second)
    found.until(lambda: [*connections._of_publisher('/estimate')] == [], 'not forgotten')


def test_of_readings_that_are_too_many_the_newest_are_used(pair, monkeypatch):
    found = pair(EstimatorNode, rest_until_input='false')  # there is no controller to wait for
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    estimates = record(found, monkeypatch)
    first = found.node.get_clock().now().nanoseconds - 200 * STEP
    send(velocity, [first + k * STEP for k in range(200)])
    counts = found.node._online.counts['velocity']
    found.until(lambda: counts.total() == 200, 'some readings are not accounted for')
    assert counts[Outcome.OVERRUN] > 0
    assert found.node._online.time == estimates[-1] == first + 199 * STEP
    assert estimates == sorted(estimates)


def test_a_node_without_parameters_reads_its_section_of_the_default_file(pair):
    node = pair(EstimatorNode).node
    assert node.options.rest_until_input  # as config/mass_spring_damper_2d.yaml has it
    assert not node.options.lockstep


def test_a_node_with_a_model_reads_no_section_of_another_file(pair):
    assert not pair(EstimatorNode, model='mass_spring_damper').node.options.rest_until_input


def test_a_change_leaves_what_was_changed_before(pair):
    node = pair(EstimatorNode).node
    for name, value in (('position.noise', [0.5, 0.5]), ('velocity.noise', [0.25, 0.25])):
        result = node.set_parameters_atomically([Parameter(name, value=value)])
        assert result.successful, result.reason
    noise = {
        name: np.sqrt(source.sensor.covariance.diagonal()).tolist()
        for name, source in node.scenario.sensors.items()
    }
    assert noise == {'position': [0.5, 0.5], 'velocity': [0.25, 0.25]}
    assert list(node.get_parameter('position.noise').value) == [0.5, 0.5]


def test_a_sensor_that_is_silent_is_named_unless_steps_wait_for_it(pair):
    found = pair(EstimatorNode, rest_until_input='false')
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    node = found.node
    send(velocity, [node.get_clock().now().nanoseconds])
    found.until(lambda: node._online.time is not None, 'no reading came')
    assert node.report()[:2] == (Level.WARN, 'no readings of position received')
    _, words, _ = node._health.report(node.scenario, 1, lockstep=True)
    assert 'no readings' not in words


def test_weights_change_while_the_node_runs_and_are_reported(pair):
    found = pair(EstimatorNode, rest_until_input='false')
    node, velocity = found.node, found.publisher(TwistWithCovarianceStamped, 'velocity')
    values = {'velocity.adapt': True, 'velocity.soft_gate': 0.9}
    given = [Parameter(name, value=value) for name, value in values.items()]
    result = node.set_parameters_atomically(given)
    assert result.successful, result.reason
    first = node.get_clock().now().nanoseconds
    message = TwistWithCovarianceStamped()
    message.twist.covariance[:] = (1e-4 * np.eye(6)).ravel()
    for k in range(12):
        message.twist.twist.linear.x = 0.2 * (-1) ** k
        write_stamp(message.header.stamp, first + k)
        velocity.publish(message)
    counts = node._online.counts['velocity']
    found.until(lambda: counts.total() == 12, 'not all readings came')
    report = node.report()[2]
    assert report['velocity: fused: with less weight, outside the soft gate'] == counts[
        Outcome.WEAKENED] > 0  # fmt: skip
    times = float(report['velocity: noise'].removesuffix(' times the declared'))
    assert times == pytest.approx(node._online.noise['velocity'] ** 0.5, rel=1e-2)
    assert times > 1.05
    result = node.set_parameters_atomically([Parameter('velocity.adapt', value=False)])
    assert result.successful, result.reason
    assert 'velocity: noise' not in node.report()[2]


@pytest.mark.parametrize(('most', 'published'), [(None, 20), (8, 8), (20, 20), (30, 20), (1, 1)])
def test_of_many_innovations_the_newest_are_published(pair, monkeypatch, most, published):
    node = pair(EstimatorNode, rest_until_input='false').node
    channel, stamps = node._fuser.channels['velocity'], []
    monkeypatch.setattr(channel, '_publish', lambda time, _: stamps.append(time))
    times = [k * STEP for k in range(1, 21)]
    readings = [Reading('velocity', time, np.zeros(2), np.eye(2)) for time in times]
    node.publish_innovations(node._fuser.fuse(readings), most)
    assert stamps == times[-published:]


def test_smoothed_estimates_are_published_once_their_lag_has_passed(pair, monkeypatch):
    node = pair(
        EstimatorNode, model='level', fixed_lag='0.3', window='0.0', rest_until_input='false'
    ).node
    publisher, online = node._smoothed, node._online
    filtered, instants, take = [], Instants(), online.on_final
    written, write = [], publisher._write

    def on_final(items):
        filtered.extend(step for step, _ in instants.take(items))
        take(items)

    def written_too(*belief):
        written.append(belief)
        return write(*belief)

    monkeypatch.setattr(online, 'on_final', on_final)
    monkeypatch.setattr(publisher, '_write', written_too)
    (name,) = node._fuser.channels
    first = node.get_clock().now().nanoseconds - 100 * STEP
    for k in range(100):
        values = np.sin(0.1 * k) * np.ones(1)
        node._fuser.fuse([Reading(name, first + k * STEP, values)])
    assert [time for time, *_ in written] == [step.time for step in filtered[: len(written)]]
    assert len(written) == len(filtered) - 30
    _, mean, covariance = written[-1]
    last = smooth(online.filter, filtered)[len(written) - 1]
    np.testing.assert_allclose(mean, last.mean, rtol=1e-9)
    np.testing.assert_allclose(covariance, last.covariance, rtol=1e-9)
    # after a reset nothing of before is published: it will not get its readings
    node._on_reset(None, Trigger.Response())
    assert len(written) == len(filtered) - 30
    written.clear()
    for k in range(100, 140):
        node._fuser.fuse([Reading(name, first + k * STEP, np.ones(1))])
    assert [time for time, *_ in written] == [first + k * STEP for k in range(100, 108)]


def test_smoothed_estimates_have_the_states_of_the_model_alone(pair):
    node = pair(
        EstimatorNode, model='level', fixed_lag='0.05', window='0.0', rest_until_input='false',
        **{'reading.bias_std': '[0.1]', 'reading.bias_noise': '[0.01]'},
    ).node  # fmt: skip
    assert len(node._online.belief.mean) == 2
    written, write = [], node._smoothed._write
    node._smoothed._write = lambda *belief: written.append(belief) or write(*belief)
    (name,) = node._fuser.channels
    first = node.get_clock().now().nanoseconds - 20 * STEP
    for k in range(20):
        node._fuser.fuse([Reading(name, first + k * STEP, np.zeros(1))])
    assert written and {(len(mean), P.shape) for _, mean, P in written} == {(1, (1, 1))}


def test_what_cannot_be_smoothed_is_refused_at_the_start(pair):
    with pytest.raises(ValueError, match='fixed_lag: expected one of'):
        pair(EstimatorNode, fixed_lag='1.0', filter='luenberger')


def test_of_the_beliefs_that_wait_the_last_one_counts(pair, monkeypatch):
    """One that is refused hides no good one before it."""
    found = pair(EstimatorNode, rest_until_input='false')
    node, poses = found.node, found.publisher(PoseWithCovarianceStamped, '/estimator/set_pose')
    means, reset = [], node._fuser.reset

    def recorded(belief):
        means.append(belief.mean[node.scenario.model.state.names.index('x')])
        reset(belief)

    monkeypatch.setattr(node._fuser, 'reset', recorded)
    message = PoseWithCovarianceStamped()
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[:] = (0.01 * np.eye(6)).ravel()
    for k in range(200):
        message.header.frame_id = 'map' if k < 199 else 'elsewhere'
        message.pose.pose.position.x = 0.01 * k
        poses.publish(message)
    found.until(lambda: means and means[-1] == pytest.approx(1.98), f'not the last: {means[-3:]}')
    # those that wait are taken together, before any of them is in effect
    assert len(means) < 150


def test_nothing_is_published_before_all_states_are_known(pair, monkeypatch):
    """Of a position alone the velocity takes a second reading."""
    found = pair(EstimatorNode, initial_std='[.inf, .inf, .inf, .inf]', rest_until_input='false')
    position = found.publisher(PoseWithCovarianceStamped, 'position')
    counts, stamps = found.node._online.counts['position'], record(found, monkeypatch)
    start = found.node.get_clock().now().nanoseconds
    for k in range(3):
        message = PoseWithCovarianceStamped()
        message.pose.covariance[:] = np.eye(6).ravel()
        message.pose.pose.position.x = 0.1 * k
        write_stamp(message.header.stamp, start + k * STEP)
        position.publish(message)
        found.until(lambda count=k + 1: counts[Outcome.FUSED] == count, 'no reading')
        if not k:
            assert np.isinf(found.node._online.belief.std[[1, 3]]).all()
    found.until(lambda: len(stamps) == 2, 'no estimate')
    assert stamps == [start + STEP, start + 2 * STEP]


def test_a_start_from_nothing_needs_real_time(pair):
    with pytest.raises(ValueError, match='^initial_std: expected finite ones with lockstep'):
        pair(EstimatorNode, initial_std='[.inf, .inf, .inf, .inf]', lockstep='true')
