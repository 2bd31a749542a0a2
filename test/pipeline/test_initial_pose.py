# SPDX-License-Identifier: Apache-2.0
"""A pose from RViz becomes a belief."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from static_frames import message as transforms

from kalman_ros import scenario
from kalman_ros.core import Gaussian
from kalman_ros.core import rotations as so3
from kalman_ros.pipeline.frames import Frames, Placement
from kalman_ros.pipeline.initial_pose import ForeignFrameError, OthersPoseError, PoseReader, moved
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


@pytest.mark.parametrize(
    ('x', 'good'), [(1e7, True), (-1e7, True), (1.001e7, False), (1e12, False)]
)
def test_a_pose_that_no_reading_could_bring_back_is_refused(x, good):
    found = scenario.build({'model': 'robot_2d'})
    read = PoseReader(found)
    if good:
        assert read(pose(x=x), found.initial_belief).mean[0] == x
        return
    with pytest.raises(ValueError, match=r'expected a position within 1e\+07 m, got'):
        read(pose(x=x), found.initial_belief)


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


def test_a_pose_in_a_frame_without_a_transform_is_refused():
    found = scenario.build({'model': 'mass_spring_damper_2d'})
    for known in (None, Frames(), frames(('world', 'map', (0.0,) * 6 + (1.0,)))):
        with pytest.raises(ForeignFrameError, match="expected frame 'map', or .*, got 'odom'"):
            PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, 'odom'), found.initial_belief, known)
    PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, '/map'), found.initial_belief)
    PoseReader(found, 'map')(rviz(0.0, 0.0, 0.0, ''), found.initial_belief)


def frames(*placed):
    found = Frames()
    found.add(transforms(*placed))
    return found


def test_a_shared_pose_is_left_to_the_node_that_moves_the_frame():
    """AMCL, or a global estimator, moves odom in the map; a static transform moves nothing."""
    found = scenario.build(from_file(shipped.file('robot_2d'), 'estimator'))
    read, start = PoseReader(found, 'odom'), found.initial_belief
    here = (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    known = Frames()
    known.add(transforms(('map', 'odom', here)), moving=True)
    known.add(transforms(('odom', 'base_link', here)), moving=True)
    known.add(transforms(('earth', 'map', here)))
    for frame in ('map', 'earth'):
        data = rviz(3.0, -4.0, 0.5, frame)
        with pytest.raises(OthersPoseError, match=f"places 'odom' in '{frame}' on /tf"):
            read(data, start, known, shared=True)
        read(data, start, known)  # on a topic of this node's, it counts
    for frame in ('odom', 'base_link'):  # in this frame, or in one that moves within it
        read(rviz(3.0, -4.0, 0.5, frame), start, known, shared=True)
    known.add(transforms(('map', 'odom', here)))
    read(rviz(3.0, -4.0, 0.5, 'map'), start, known, shared=True)
    assert not known.moves_in('odom', 'nowhere')


def test_a_pose_in_another_frame_is_transformed_with_its_covariance():
    """The map lies a quarter turn from the odometry: its x is y there, and variances follow."""
    found = scenario.build(from_file(shipped.file('robot_2d'), 'estimator'))
    indices = found.model.state.indices(('x', 'y', 'yaw'))
    turn = (0.0, 0.0, 0.5**0.5, 0.5**0.5)
    message = rviz(3.0, -4.0, 0.5, 'map')
    pose = deserialize_message(message, PoseWithCovarianceStamped)
    pose.pose.covariance[0], pose.pose.covariance[7] = 0.5, 0.1
    data = bytes(serialize_message(pose))
    known = frames(('odom', 'map', (10.0, 20.0, 0.0, *turn)))
    belief = PoseReader(found, 'odom')(data, found.initial_belief, known)
    expected = [10.0 + 4.0, 20.0 + 3.0, 0.5 + np.pi / 2]
    np.testing.assert_allclose(belief.mean[indices], expected, rtol=1e-12)
    np.testing.assert_allclose(
        belief.covariance[np.ix_(indices, indices)], np.diag([0.1, 0.5, 0.0685]), atol=1e-12
    )
    # the odometry as a child of the map, as an estimator with odom_frame publishes it
    inverse = (-20.0, 10.0, 0.0, 0.0, 0.0, -(0.5**0.5), 0.5**0.5)
    other = PoseReader(found, 'odom')(data, found.initial_belief, frames(('map', 'odom', inverse)))
    np.testing.assert_allclose(other.mean, belief.mean, rtol=1e-12)


def test_errors_of_a_pose_turn_with_its_frame():
    """Noisy poses, each transformed by itself, scatter as the transformed covariance says."""
    rng = np.random.default_rng(2)
    place = Placement(np.array([1.0, 2.0, 3.0]), np.array([0.4, -0.9, 1.3]))
    root = 1e-3 * rng.normal(size=(6, 6))
    pose, turn = np.array([4.0, 5.0, 6.0, 0.3, -0.2, 2.0]), Rotation.from_rotvec(place.rotation)
    there, C = moved(pose, root @ root.T, place)
    attitude = Rotation.from_euler('xyz', pose[3:])
    np.testing.assert_allclose(there[:3], turn.apply(pose[:3]) + place.translation)
    np.testing.assert_allclose(
        Rotation.from_euler('xyz', there[3:]).as_matrix(),
        (turn * attitude).as_matrix(),
        atol=1e-12,
    )
    G, step = np.zeros((6, 6)), 1e-6
    for k, error in enumerate(step * np.eye(6)):
        noisy = Rotation.from_rotvec(error[3:]) * attitude
        other, _ = moved(np.r_[pose[:3] + error[:3], noisy.as_euler('xyz')], 0.0 * C, place)
        turned = Rotation.from_euler('xyz', other[3:]) * (turn * attitude).inv()
        G[:, k] = np.r_[other[:3] - there[:3], turned.as_rotvec()] / step
    np.testing.assert_allclose(C, G @ root @ root.T @ G.T, atol=1e-11)


def test_what_a_pose_of_rviz_gives_no_variance_stays_unknown_in_another_frame():
    found = scenario.build(from_file(shipped.file('robot_3d'), 'estimator'))
    turn = Rotation.from_euler('z', 0.7).as_quat()
    known = frames(('odom', 'map', (1.0, 2.0, 30.0, *turn)))
    before = found.initial_belief
    belief = PoseReader(found, 'odom')(rviz(3.0, -4.0, 2.0), before, known)
    space = found.model.state
    assert belief.mean[2] == before.mean[2]
    assert belief.covariance[2, 2] == before.covariance[2, 2]
    attitude = so3.to_euler(belief.mean[space.indices(('rx', 'ry', 'rz'))])
    np.testing.assert_allclose(attitude, [0.0, 0.0, 2.7], atol=1e-12)


@pytest.mark.parametrize('x', [np.nan, np.inf, 1e300])
def test_a_pose_that_is_not_finite_is_refused_in_another_frame_too(x):
    found = scenario.build(from_file(shipped.file('robot_2d'), 'estimator'))
    known = frames(('odom', 'map', (1e153, 1e153, 0.0, 0.0, 0.0, 1.0, 1.0)))
    try:
        belief = PoseReader(found, 'odom')(rviz(x, 1e153, 2.0), found.initial_belief, known)
    except ValueError as error:
        assert 'expected finite numbers' in str(error)
    else:
        assert np.isfinite(belief.mean).all() and np.isfinite(x)
