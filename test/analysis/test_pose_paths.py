# SPDX-License-Identifier: Apache-2.0
"""How far two paths are apart, by paths whose distance is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kalman_ros.analysis.pose_paths import PosePath, path_of_states, separation
from kalman_ros.core import Signal, Space
from kalman_ros.core import rotations as so3

RADIUS, TURN = 5.0, 0.2


def circle(time, planar=True):
    """Return poses of a body that drives a circle and looks ahead."""
    a = TURN * np.asarray(time)
    position = np.stack((RADIUS * np.sin(a), RADIUS * (1 - np.cos(a)), np.zeros_like(a)), axis=-1)
    rotation = so3.shortest(np.stack((0 * a, 0 * a, a), axis=-1))
    return PosePath(np.asarray(time, dtype=float), position, rotation, frame='map', planar=planar)


def moved(path, yaw, shift):
    """Return a path in a frame that is turned and shifted."""
    R = Rotation.from_euler('z', yaw)
    turned = (R * Rotation.from_rotvec(path.rotation)).as_rotvec()
    return replace(path, position=R.apply(path.position) + shift, rotation=turned, frame='odom')


TIME = np.arange(0.0, 30.0, 0.1)


def test_a_path_is_at_no_distance_of_itself():
    found = separation(circle(TIME), circle(np.arange(0.0, 30.0, 0.05)), align=False)
    assert found.ate < 1e-3 and found.heading < 1e-12  # between two poses it is a chord
    assert len(found.time) == len(TIME) and np.isnan(found.nees)


@pytest.mark.parametrize('yaw', [0.3, -2.9, np.pi])
def test_alignment_finds_the_turn_and_the_shift(yaw):
    path = moved(circle(TIME), yaw, [3.0, -4.0, 0.0])
    apart = separation(path, circle(TIME), align=False)
    assert apart.ate > 1.0 and apart.heading == pytest.approx(abs(yaw))
    aligned = separation(path, circle(TIME), align=True)
    assert aligned.ate < 1e-9 and aligned.heading < 1e-9 and aligned.aligned
    # relative errors are those of moves, which no frame changes
    for part in (*apart.relative, *aligned.relative):
        assert part.position < 1e-9 and part.rotation < 1e-9 and part.count > 10


def test_a_constant_shift_is_the_absolute_error():
    path = replace(circle(TIME), position=circle(TIME).position + np.array([0.3, 0.4, 9.0]))
    found = separation(path, circle(TIME), align=False)
    assert found.ate == pytest.approx(0.5)  # the plane has no height
    found = separation(replace(path, planar=False), circle(TIME, planar=False), align=False)
    assert found.ate == pytest.approx(np.hypot(0.5, 9.0))


def test_a_scale_is_a_relative_error_that_grows_with_the_length():
    straight = PosePath(TIME, np.outer(TIME, [1.0, 0.0, 0.0]), np.zeros((len(TIME), 3)))
    wheels = replace(straight, position=1.02 * straight.position)
    found = separation(wheels, straight, align=False)
    assert [part.length for part in found.relative] == [1.0, 5.0, 10.0]
    for part in found.relative:
        assert part.position == pytest.approx(0.02 * part.length, rel=1e-6)
        assert part.rotation < 1e-12
        assert part.count == pytest.approx((29.9 - part.length) / 0.1, abs=2)


def test_a_drift_of_the_heading_is_a_relative_rotation():
    drift = 0.01 * TIME
    path = circle(TIME)
    turned = so3.compose(np.stack((0 * drift, 0 * drift, drift), axis=-1), path.rotation)
    found = separation(replace(path, rotation=turned), path, align=False)
    for part in found.relative:  # at 1 m/s
        assert part.rotation == pytest.approx(0.01 * part.length, abs=0.001 + 1e-6)


def test_of_consistent_estimates_the_squared_difference_is_as_expected():
    rng, n = np.random.default_rng(0), 4000
    time = np.arange(n) * 0.1
    P, Q = np.diag([0.04, 0.09, 0.0]), np.diag([0.01, 0.02, 0.0])
    true = circle(time)
    C = np.broadcast_to(P, (n, 3, 3))
    path = replace(
        true, position=true.position + rng.normal(size=(n, 3)) @ np.sqrt(P), covariance=C
    )
    other = replace(
        true,
        position=true.position + rng.normal(size=(n, 3)) @ np.sqrt(Q),
        covariance=np.broadcast_to(Q, (n, 3, 3)),
    )
    # 4 standard deviations of the mean of n chi-square numbers of 2 degrees of freedom, by 2
    assert separation(path, true, align=False).nees == pytest.approx(1.0, abs=4 / np.sqrt(n))
    assert separation(path, other, align=False).nees == pytest.approx(1.0, abs=4 / np.sqrt(n))


def test_rotations_are_interpolated_the_short_way():
    path = PosePath(np.array([0.0, 1.0]), np.zeros((2, 3)), np.array([[0, 0, 3.0], [0, 0, -3.0]]))
    (found,) = path.at(np.array([0.5])).rotation
    assert abs(found[2]) == pytest.approx(np.pi)
    assert np.isnan(path.at(np.array([-0.1, 1.1])).position).all()


@pytest.mark.parametrize('time', [[], [1.0], [100.0, 101.0]])
def test_what_is_never_known_at_one_time_is_nothing(time):
    other = circle(np.array(time))
    assert separation(circle(TIME), other, align=True) is None
    assert separation(other, circle(TIME), align=True) is None


def test_a_path_that_stands_is_aligned_without_a_turn():
    still = PosePath(TIME, np.ones((len(TIME), 3)), np.zeros((len(TIME), 3)))
    found = separation(still, replace(still, position=still.position + 5.0), align=True)
    assert found.ate < 1e-12 and found.relative == ()


@pytest.mark.parametrize(('extent', 'turns'), [(0.9e-3, False), (1.1e-3, True)])
def test_a_path_is_turned_only_where_both_move_in_the_plane(extent, turns):
    """By more than a millimetre about their means; how far they rise does not count."""
    a = np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False)
    round_ = np.stack((np.cos(a), np.sin(a), 9.0 * np.sin(a)), axis=-1)
    turned = round_[:, [1, 0, 2]] * np.array([-1.0, 1.0, 1.0])  # by 90 degrees
    large = PosePath(a, round_, np.zeros((100, 3)))
    small = replace(large, position=turned * np.array([extent, extent, 1.0]))
    for path, reference, yaw in ((large, small, 0.5 * np.pi), (small, large, -0.5 * np.pi)):
        aligned = path.aligned_with(reference)
        expected = [0.0, 0.0, yaw if turns else 0.0]
        np.testing.assert_allclose(aligned.rotation, np.tile(expected, (100, 1)), atol=1e-9)
        np.testing.assert_allclose(aligned.position[:, 2], path.position[:, 2], atol=1e-9)


def test_states_are_poses_in_the_order_of_time_and_the_last_of_one_time_counts():
    space = Space(('v', 'y', 'x', 'yaw'), ('m/s', 'm', 'm', 'rad'), angles=('yaw',))
    fields = tuple(f'position[{name}]' for name in space.names)
    signal = Signal('estimate', 'sensor_msgs/JointState', fields)
    mean = np.array([[0, 2.0, 1.0, 0.1], [0, 4.0, 3.0, 0.2], [0, 6.0, 5.0, 0.3]])
    P = np.array([np.diag([9.0, 2.0, 1.0, 0.5])] * 3)
    path = path_of_states(space, signal, np.array([1.0, 0.0, 1.0]), mean, P, 'map')
    np.testing.assert_array_equal(path.time, [0.0, 1.0])
    np.testing.assert_array_equal(path.position, [[3.0, 4.0, 0.0], [5.0, 6.0, 0.0]])
    np.testing.assert_allclose(path.rotation[:, 2], [0.2, 0.3])
    np.testing.assert_array_equal(path.covariance[0], np.diag([1.0, 2.0, 0.0]))
    assert path.planar
    flat = Space(('x', 'v'), ('m', 'm/s'))
    alone = Signal('estimate', 'sensor_msgs/JointState', ('position[x]', 'position[v]'))
    assert path_of_states(flat, alone, np.zeros(1), np.zeros((1, 2)), None, '') is None


def test_what_is_not_known_in_a_gap_is_not_compared():
    """A truth of the first and the last seconds says nothing of the time between."""
    path = circle(TIME)
    known = (TIME < 5.0) | (TIME > 20.0)
    part = replace(
        path, time=TIME[known], position=path.position[known], rotation=path.rotation[known]
    )
    found = separation(path, part, align=False)
    assert found.ate < 1e-9 and found.heading < 1e-9
    assert len(found.time) == known.sum()
    assert np.isnan(part.at(np.array([12.0])).position).all()


@pytest.mark.parametrize('tilt', [(0.0, 1.0), (3.1, 0.0), (0.5, -1.2)])
def test_the_heading_is_that_of_the_level(tilt):
    path = circle(TIME, planar=False)
    yaw = so3.to_euler(path.rotation)[:, 2]

    def tilted(offset):
        roll, pitch = np.full_like(yaw, tilt[0]), np.full_like(yaw, tilt[1])
        turns = np.stack((roll, pitch, yaw + offset), axis=-1)
        return replace(path, rotation=so3.from_euler(turns))

    assert separation(tilted(0.1), tilted(0.0), align=False).heading == pytest.approx(0.1)
    flat = separation(circle(TIME), tilted(0.0), align=False)
    assert flat.heading < 1e-9 and all(part.position < 1e-9 for part in flat.relative)
