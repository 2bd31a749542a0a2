# SPDX-License-Identifier: Apache-2.0
"""A pose from RViz becomes a belief."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.serialization import serialize_message

from kalman_ros import scenario
from kalman_ros.core import Gaussian
from kalman_ros.core import rotations as so3
from kalman_ros.pipeline.initial_pose import PoseReader
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

NAMES = ('x', 'v_x', 'y', 'v_y')


def pose(x=1.0, y=2.0, variance=0.25, quaternion=(0.0, 0.0, 0.0, 1.0)):
    message = PoseWithCovarianceStamped()
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.covariance[:] = (variance * np.eye(6)).ravel()
    return bytes(serialize_message(message))


def test_the_pose_is_put_in_and_the_rest_stays():
    found = scenario.build({'model': 'mass_spring_damper_2d'})
    assert found.model.state.names == NAMES
    root = np.random.default_rng(0).normal(size=(4, 4))
    before = Gaussian(np.array([9.0, 8.0, 7.0, 6.0]), root @ root.T)
    mean, covariance = before.mean.copy(), before.covariance.copy()
    belief = PoseReader(found)(pose(), before)
    np.testing.assert_array_equal(belief.mean, [1.0, 8.0, 2.0, 6.0])
    expected = covariance.copy()
    expected[[0, 2], :] = 0.0
    expected[:, [0, 2]] = 0.0
    expected[[0, 2], [0, 2]] = 0.25
    np.testing.assert_array_equal(belief.covariance, expected)
    np.testing.assert_array_equal(before.mean, mean)
    np.testing.assert_array_equal(before.covariance, covariance)


@pytest.mark.parametrize(
    ('model', 'data', 'says'),
    [
        ('mass_spring_damper_2d', pose(x=np.nan), 'expected finite numbers'),
        ('mass_spring_damper_2d', pose(variance=-1.0), 'covariance: expected a positive definite'),
        (
            'robot_2d',
            pose(variance=1.0, quaternion=(0.0,) * 4),
            'orientation: expected a quaternion',
        ),
        ('dc_motor', pose(), 'no pose'),
    ],
)
def test_what_is_no_belief_is_refused(model, data, says):
    found = scenario.build({'model': model})
    with pytest.raises(ValueError, match=says):
        PoseReader(found)(data, found.initial_belief)


def test_a_pose_without_a_covariance_has_the_initial_one():
    found = scenario.build({'model': 'robot_2d'})
    belief = PoseReader(found)(pose(variance=0.0), found.initial_belief)
    np.testing.assert_array_equal(belief.covariance, found.initial_belief.covariance)
    assert belief.mean[:2].tolist() == [1.0, 2.0]


def rviz(x, y, yaw, frame='map'):
    """Return a pose in the plane as RViz sends it: no variance of height, roll and pitch."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y = x, y
    turn.z, turn.w = np.sin(yaw / 2.0), np.cos(yaw / 2.0)
    message.pose.covariance[0] = message.pose.covariance[7] = 0.25
    message.pose.covariance[35] = 0.0685
    return bytes(serialize_message(message))


@pytest.mark.parametrize(
    ('model', 'heading'),
    [('robot_2d', 'yaw'), ('gnss_imu', 'psi'), ('diff_drive', 'yaw'), ('turn_rate', 'psi')],
)
def test_a_pose_of_rviz_sets_any_state_with_a_position_and_a_heading(model, heading):
    found = scenario.build(from_file(shipped.file(model), 'estimator'))
    space, before = found.model.state, found.initial_belief
    heading = heading if heading in space.names else space.angles[0]
    indices = space.indices(('x', 'y', heading))
    belief = PoseReader(found, 'map')(rviz(3.0, -4.0, 2.5), before)
    np.testing.assert_allclose(belief.mean[indices], [3.0, -4.0, 2.5], rtol=1e-12)
    np.testing.assert_allclose(belief.covariance[indices, indices], [0.25, 0.25, 0.0685])
    others = [k for k in range(space.size) if k not in indices]
    np.testing.assert_array_equal(belief.mean[others], before.mean[others])


@pytest.mark.parametrize('model', ['robot_3d', 'inertial'])
def test_a_pose_of_rviz_turns_a_rotation_and_leaves_height_and_tilt(model):
    found = scenario.build(from_file(shipped.file(model), 'estimator'))
    space, before = found.model.state, found.initial_belief
    turned = space.indices(('rx', 'ry', 'rz'))
    tilted = before.mean.copy()
    tilted[turned] = so3.from_euler(np.array([0.1, -0.2, 0.3]))
    tilted[2] = 7.0
    belief = PoseReader(found)(rviz(3.0, -4.0, 2.5), Gaussian(tilted, before.covariance))
    np.testing.assert_allclose(belief.mean[:3], [3.0, -4.0, 7.0])
    np.testing.assert_allclose(so3.to_euler(belief.mean[turned]), [0.1, -0.2, 2.5], atol=1e-12)
    variances = belief.covariance.diagonal()
    assert variances[turned[2]] == 0.0685
    np.testing.assert_array_equal(variances[turned[:2]], before.covariance[turned, turned][:2])
    assert variances[2] == before.covariance[2, 2]


def test_a_pose_in_another_frame_is_refused():
    found = scenario.build({'model': 'mass_spring_damper_2d'})
    with pytest.raises(ValueError, match="expected frame 'map', got 'odom'"):
        PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, 'odom'), found.initial_belief)
    PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, '/map'), found.initial_belief)
    PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, ''), found.initial_belief)
