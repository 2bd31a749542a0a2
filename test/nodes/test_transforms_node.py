# SPDX-License-Identifier: Apache-2.0
"""Transforms of the estimator on the real /tf, where tf2_msgs is installed, or one line."""

import importlib.util

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from static_frames import message as transforms

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
    found.until(driven(lambda: found.node._estimates.count > count + 20), 'no estimates')
    assert publisher.count == count


def pose_in(frame):
    found = PoseWithCovarianceStamped()
    found.header.frame_id = frame
    found.pose.pose.position.x, found.pose.pose.orientation.w = 5.0, 1.0
    found.pose.covariance[:] = (1e-6 * np.eye(6)).ravel()
    return found


@pytest.mark.skipif(INSTALLED, reason='tf2_msgs is installed')
def test_without_tf2_msgs_a_pose_in_another_frame_is_refused_in_one_line(started, capfd):
    found = started()
    found.publisher(PoseWithCovarianceStamped, 'initialpose').publish(pose_in('map'))
    said = []

    def refused():
        said.append(capfd.readouterr().err)
        return "expected frame 'odom'" in ''.join(said)

    found.until(refused, 'no refusal')
    (line,) = [line for line in ''.join(said).splitlines() if 'initialpose' in line]
    assert "or one with a transform, got 'map'; the message package 'tf2_msgs' is" in line


@pytest.mark.skipif(not INSTALLED, reason='tf2_msgs is not installed')
def test_a_pose_in_another_frame_waits_for_its_transform(started):
    from tf2_msgs.msg import TFMessage

    found = started()
    poses = found.publisher(PoseWithCovarianceStamped, 'set_pose')
    others = found.publisher(TFMessage, '/tf')
    x = found.node.scenario.model.state.names.index('x')
    before = found.node.count_subscribers('/tf')
    poses.publish(pose_in('map'))
    found.until(lambda: found.node.count_subscribers('/tf') > before, 'no search')

    def placed():
        others.publish(transforms(('map', 'odom', (2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))))
        return found.node._online.belief.mean[x] == pytest.approx(3.0)

    found.until(placed, 'no reset')
    found.until(lambda: found.node.count_subscribers('/tf') == before, 'the search goes on')
    # of two poses the later one counts, and a search that finds nothing ends
    poses.publish(pose_in('nowhere'))
    found.until(lambda: found.node.count_subscribers('/tf') > before, 'no search')
    poses.publish(pose_in('odom'))
    found.until(lambda: found.node._online.belief.mean[x] == pytest.approx(5.0), 'no reset')
    found.until(lambda: found.node.count_subscribers('/tf') == before, 'the search goes on')
    # what RViz publishes for all is for the node that places odom in the map, such as AMCL
    resets = found.node._fuser.resets
    found.publisher(PoseWithCovarianceStamped, 'initialpose').publish(pose_in('map'))
    found.until(lambda: found.node.count_subscribers('/tf') > before, 'no search')
    found.until(lambda: placed() or found.node.count_subscribers('/tf') == before, 'no end')
    assert found.node._fuser.resets == resets


@pytest.mark.real_time
@pytest.mark.skipif(not INSTALLED, reason='tf2_msgs is not installed')
def test_a_pose_in_a_frame_without_a_transform_is_refused_in_time(started, capfd):
    found = started()
    found.publisher(PoseWithCovarianceStamped, 'initialpose').publish(pose_in('nowhere'))
    said = []

    def refused():
        said.append(capfd.readouterr().err)
        return "got 'nowhere'" in ''.join(said)

    found.until(refused, 'no refusal')
