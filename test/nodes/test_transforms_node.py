# SPDX-License-Identifier: Apache-2.0
"""Transforms of the estimator on the real /tf, where tf2_msgs is installed, or one line."""

import importlib.util

import pytest
from nav_msgs.msg import Odometry

from kalman_ros.codecs.messages import decode, write_stamp
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

TF = {'publish_tf': 'true', 'publish_odometry': 'true', 'frame': 'odom'}
INSTALLED = importlib.util.find_spec('tf2_msgs') is not None


@pytest.fixture
def started(pair):
    return lambda **more: pair(EstimatorNode, file=str(shipped.file('robot_2d')), **TF, **more)


@pytest.mark.skipif(INSTALLED, reason='tf2_msgs is installed')
def test_without_tf2_msgs_the_estimator_starts_and_says_so_in_one_line(started, capfd):
    assert started().node.phase == 'active'
    (line,) = [line for line in capfd.readouterr().err.splitlines() if 'tf2_msgs' in line]
    assert "publish_tf: no transform is published: the message package 'tf2_msgs' is" in line


@pytest.mark.skipif(not INSTALLED, reason='tf2_msgs is not installed')
def test_the_transform_is_that_of_the_estimate_until_a_second_parent_shows_up(started):
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    found = started()
    kinds = {'/tf': TFMessage, 'estimate/odometry': Odometry}
    received = {topic: [] for topic in kinds}
    subscriptions = {
        topic: found.peer.create_subscription(kind, topic, print, 10, raw=True)
        for topic, kind in kinds.items()
    }

    def take():
        for topic, subscription in subscriptions.items():
            kind = kinds[topic]
            while (taken := subscription.handle.take_message(kind, True)) is not None:
                received[topic].append(decode(taken[0], kind))
        return all(received.values())

    wheels = found.publisher(Odometry, 'odom')
    others = found.publisher(TFMessage, '/tf')

    def drive():
        message = Odometry()
        write_stamp(message.header.stamp, found.node.get_clock().now().nanoseconds)
        message.twist.twist.linear.x = 1.0
        wheels.publish(message)

    def driven(condition):
        return lambda: drive() or condition()

    found.until(driven(take), 'no transform')
    (transform,), odometry = received['/tf'][-1].transforms, received['estimate/odometry'][-1]
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert transform.transform.rotation.w == pytest.approx(
        odometry.pose.pose.orientation.w, abs=0.1
    )
    other = TFMessage(transforms=[TransformStamped()])
    other.transforms[0].header.frame_id, other.transforms[0].child_frame_id = 'map', 'base_link'
    publisher = found.node._transforms
    others.publish(other)
    found.until(driven(lambda: 'has the parent' in publisher.refusal), 'two parents')
    count = publisher.count
    found.until(driven(lambda: found.node._publish.count > count + 20), 'no estimates')
    assert publisher.count == count
