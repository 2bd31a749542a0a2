# SPDX-License-Identifier: Apache-2.0
"""Poses as velocities and as changes from the first, and the covariance of a difference."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('rclpy')

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Signal
from kalman_ros.pipeline.pose_changes import FirstPoseError, PoseChange, whole_pose

PLANE = ('pose.pose.position.x', 'pose.pose.position.y', 'pose.pose.orientation.yaw')
SECOND = 1_000_000_000


def change(pose, *fields):
    return PoseChange(Signal('odom', 'nav_msgs/Odometry', fields or PLANE, pose=pose))


def sample(time, p, rotation, C=None):
    values = np.concatenate((p, rotation.as_rotvec()))
    return Sample(round(time * SECOND), values, C)


def test_the_fields_of_the_whole_pose_are_read():
    signal = Signal('odom', 'nav_msgs/Odometry', PLANE[:1])
    assert whole_pose(signal).fields == (
        *(f'pose.pose.position.{axis}' for axis in 'xyz'),
        *(f'pose.pose.orientation.{axis}' for axis in ('rx', 'ry', 'rz')),
    )
    alone = whole_pose(Signal('imu', 'sensor_msgs/Imu', ('orientation.yaw',)))
    assert alone.fields == ('orientation.rx', 'orientation.ry', 'orientation.rz')
    with pytest.raises(ValueError, match='pose: expected fields of a position or orientation'):
        whole_pose(Signal('imu', 'sensor_msgs/Imu', ('angular_velocity.z',)))
    with pytest.raises(ValueError, match='pose: expected fields of a position .*got east, north'):
        whole_pose(Signal('fix', 'sensor_msgs/NavSatFix', ('east', 'north')))


def test_a_drive_on_a_circle_has_constant_velocities():
    """At 2 m/s and 0.5 rad/s, whatever the origin of the odometry, and its heading."""
    origin, found = Rotation.from_euler('z', 2.0), change('differential')
    for k in range(5):
        angle = 0.05 * k
        p = 4.0 * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        pose = sample(0.1 * k, np.array([7.0, 8.0, 0.0]) + origin.apply(p), origin * yaw(angle))
        if k == 0:
            with pytest.raises(FirstPoseError):
                found(pose)
        else:
            # the chord is shorter than the arc
            chord = 2.0 * np.sin(0.025) / 0.025
            np.testing.assert_allclose(found(pose).values, [chord, 0.0, 0.5], atol=1e-9)


def yaw(angle):
    return Rotation.from_euler('z', angle)


def test_a_relative_pose_is_seen_from_the_first():
    first, turn = Rotation.from_euler('xyz', [0.1, 0.2, 2.0]), Rotation.from_euler('z', 0.4)
    found = change('relative')
    with pytest.raises(FirstPoseError):
        found(sample(0.0, [1.0, 2.0, 3.0], first))
    for time in (5.0, 50.0):
        later = sample(
            time, np.array([1.0, 2.0, 3.0]) + first.apply([0.5, 0.6, 0.0]), first * turn
        )
        np.testing.assert_allclose(found(later).values, [0.5, 0.6, 0.4], atol=1e-12)


def test_a_first_pose_that_is_not_finite_is_not_the_one_to_compare_with():
    found, straight = change('relative'), Rotation.identity()
    bad = sample(0.0, [np.nan, 0.0, 0.0], straight)
    np.testing.assert_array_equal(found(bad).values, np.full(len(PLANE), np.nan))
    with pytest.raises(FirstPoseError):
        found(sample(0.1, [1.0, 0.0, 0.0], straight))
    np.testing.assert_allclose(found(sample(0.2, [3.0, 0.0, 0.0], straight)).values[0], 2.0)


def test_after_a_gap_a_velocity_starts_again():
    found, straight = change('differential'), Rotation.identity()
    for time, usable in ((0.0, False), (0.1, True), (0.1, False), (5.0, False), (5.1, True)):
        pose = sample(time, [2.0 * time, 0.0, 0.0], straight)
        if usable:
            np.testing.assert_allclose(found(pose).values, [2.0, 0.0, 0.0], atol=1e-12)
        else:
            with pytest.raises(FirstPoseError):
                found(pose)
    bad = sample(5.2, [np.nan, 0.0, 0.0], straight)
    assert np.isnan(found(bad).values[0])
    np.testing.assert_allclose(found(sample(5.3, [10.6, 0.0, 0.0], straight)).values[0], 2.0)


@pytest.mark.slow
def test_an_odometry_that_integrates_has_the_covariance_of_what_it_added():
    """The velocities of 2000 odometries scatter as their covariance says, although poses drift."""
    rng, steps, dt = np.random.default_rng(6), 20, 0.1
    q = np.diag([1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-5])
    squares = []
    for _ in range(200):
        found, p, errors = change('differential'), np.zeros(3), np.zeros(6)
        for k in range(steps):
            C = (k + 1) * q
            errors = errors + rng.multivariate_normal(np.zeros(6), q)
            pose = sample(dt * k, p + errors[:3], Rotation.from_rotvec(errors[3:]), C)
            if k == 0:
                with pytest.raises(FirstPoseError):
                    found(pose)
                continue
            _, v, P = found(pose)
            squares.append(v @ np.linalg.solve(P, v) / 3.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.07)  # 5 sigma of 3800 readings


@pytest.mark.slow
def test_independent_poses_have_the_sum_of_their_covariances():
    """Of which the heading at a lever arm is a part."""
    rng = np.random.default_rng(7)
    C = np.diag([1e-2, 1e-2, 1e-2, 1e-6, 1e-6, 1e-3])
    squares = []
    for _ in range(2000):
        found, e = change('differential'), rng.multivariate_normal(np.zeros(6), C, 2)
        with pytest.raises(FirstPoseError):
            found(sample(0.0, e[0, :3], Rotation.from_rotvec(e[0, 3:]), C))
        moved = np.array([10.0, 0.0, 0.0]) + e[1, :3]
        _, v, P = found(sample(1.0, moved, Rotation.from_rotvec(e[1, 3:]), C))
        squares.append(v[1:] @ np.linalg.solve(P[1:, 1:], v[1:]) / 2.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.11)  # 5 sigma


WHOLE = tuple(
    f'pose.pose.{part}'
    for part in (*(f'position.{axis}' for axis in 'xyz'),
                 *(f'orientation.{axis}' for axis in ('rx', 'ry', 'rz')))
)  # fmt: skip


@pytest.mark.parametrize('pose', ['relative', 'differential'])
def test_the_covariance_of_a_whole_pose_is_that_of_the_derivatives(pose):
    """Independent errors of both poses, in the world's axes, moved one by one."""
    rng = np.random.default_rng(3)
    dt, size = 0.5, 1e-6
    places = [np.array([3.0, -2.0, 1.0]), np.array([3.4, -1.1, 1.3])]
    turns = [Rotation.from_rotvec([0.3, -0.8, 1.2]), Rotation.from_rotvec([0.35, -0.82, 1.24])]
    C_0, C_1 = (A @ A.T + 0.01 * np.eye(6) for A in rng.normal(size=(2, 6, 6)))

    def changed(errors, *covariances):
        of_pose = change(pose, *WHOLE)
        moved = [
            sample(k * dt, places[k] + e[:3], Rotation.from_rotvec(e[3:]) * turns[k], C)
            for k, (e, C) in enumerate(zip(errors, covariances or (None, None)))
        ]
        with pytest.raises(FirstPoseError):
            of_pose(moved[0])
        return of_pose(moved[1])

    def error(given):
        """Return a change's error: a rotation's is one about the axes of the body before it."""
        scale = dt if pose == 'differential' else 1.0
        turned = [Rotation.from_rotvec(scale * v[3:]) for v in (given, right)]
        e = (turned[0] * turned[1].inv()).as_rotvec() / scale
        return np.concatenate((given[:3] - right[:3], e))

    right = changed(np.zeros((2, 6))).values
    J = np.array([
        error(changed(step.reshape(2, 6)).values) / size for step in size * np.eye(12)
    ]).T  # fmt: skip
    exact = J[:, :6] @ C_0 @ J[:, :6].T + J[:, 6:] @ C_1 @ J[:, 6:].T
    covariance = changed(np.zeros((2, 6)), C_0, C_1).covariance
    # between the poses a velocity's axes are those on the way, which differ by half of the turn
    tolerance = 1e-5 if pose == 'relative' else 0.1
    np.testing.assert_allclose(covariance, exact, atol=tolerance * np.abs(exact).max())


@pytest.mark.parametrize('first', [0, 7])
def test_poses_a_second_apart_are_a_velocity_and_a_nanosecond_more_is_too_much(first):
    """A simulated clock begins at 0, which is a time like any other."""
    pose = sample(0.0, [1.0, 0.0, 0.0], Rotation.identity())
    later = sample(0.0, [3.0, 0.0, 0.0], Rotation.identity())
    for passed, usable in ((1, True), (SECOND, True), (SECOND + 1, False)):
        found = change('differential')
        with pytest.raises(FirstPoseError):
            found(pose._replace(time=first))
        if usable:
            velocity = found(later._replace(time=first + passed)).values[0]
            np.testing.assert_allclose(velocity, 2.0 * SECOND / passed)
        else:
            with pytest.raises(FirstPoseError):
                found(later._replace(time=first + passed))
