# SPDX-License-Identifier: Apache-2.0
"""Transforms of an estimate, as far as they need no tf2_msgs: frames, times and refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('rclpy')

from kalman_ros.pipeline.frames import Placement
from kalman_ros.pipeline.odometry_topic import OdometryTopic
from kalman_ros.pipeline.settings import settings
from kalman_ros.pipeline.transforms import TransformTree, check_frame
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

SECOND = 1_000_000_000


def matrix(pose):
    found = np.eye(4)
    found[:3, :3] = Rotation.from_rotvec(pose.rotation).as_matrix()
    found[:3, 3] = pose.translation
    return found


def test_one_body_in_two_frames_gives_the_transform_between_them():
    rng = np.random.default_rng(5)
    in_map, in_odom = (Placement(rng.normal(size=3), rng.normal(size=3)) for _ in range(2))
    expected = matrix(in_map) @ np.linalg.inv(matrix(in_odom))
    np.testing.assert_allclose(matrix(in_map.then(in_odom.inverse())), expected, atol=1e-12)


def test_a_second_parent_and_a_loop_are_refused():
    tree = TransformTree()
    assert not tree.refusal('odom', 'base_link', 0)
    tree.add('odom', 'base_link', 0, static=False)
    assert not tree.refusal('odom', 'base_link', 1)
    why = "'base_link' has the parent 'odom' already and cannot have 'map', too"
    assert tree.refusal('map', 'base_link', 1) == why
    assert not tree.refusal('map', 'base_link', 60 * SECOND)  # of a node that has ended
    tree.add('base_link', 'laser', 0, static=True)
    tree.add('laser', 'odom', 0, static=True)
    found = tree.refusal('odom', 'base_link', 60 * SECOND)
    assert found == "'base_link' is above 'odom' already: a loop"
    tree.add('a', 'b', 0, static=True)
    tree.add('b', 'a', 0, static=True)  # a loop of others is none of this one
    assert not tree.refusal('a', 'c', 0)


@pytest.mark.parametrize('name', ['', '/base_link'])
def test_a_name_that_tf2_refuses_is_refused(name):
    with pytest.raises(ValueError, match='child_frame: expected a frame without a leading slash'):
        check_frame('child_frame', name)


def test_the_estimate_is_an_odometry_whatever_its_own_message():
    given = from_file(shipped.file('robot_3d'), 'estimator')
    known = settings({**given, 'publish_odometry': True}).scenario
    topic = OdometryTopic(known, 'odom', 'base_link')
    belief = known.initial_belief
    x, P = belief.mean.copy(), np.diag(np.arange(1.0, 16.0))
    x[:12] = 1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 4.0, 5.0, 6.0, 0.4, 0.5, 0.6
    message = topic(7 * SECOND, belief._replace(mean=x, covariance=P))
    pose, twist = message.pose.pose, message.twist.twist
    q = pose.orientation
    np.testing.assert_allclose(
        Rotation.from_quat((q.x, q.y, q.z, q.w)).as_rotvec(), x[3:6], atol=1e-12
    )
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert (pose.position.x, twist.linear.z, twist.angular.y) == (1.0, 6.0, 0.5)
    np.testing.assert_allclose(np.diag(message.pose.covariance.reshape(6, 6)), range(1, 7))
    np.testing.assert_allclose(np.diag(message.twist.covariance.reshape(6, 6)), range(7, 13))


def test_a_state_without_a_heading_is_no_odometry():
    known = settings(from_file(shipped.file('constant_velocity'), 'estimator')).scenario
    with pytest.raises(ValueError, match='publish_odometry: expected states x, y and a heading'):
        OdometryTopic(known, 'odom', 'base_link')
