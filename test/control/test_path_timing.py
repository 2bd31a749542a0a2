# SPDX-License-Identifier: Apache-2.0
"""Paths in time: speed and acceleration within their limits, from rest to rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalman_ros.control.path_timing import headings, interpolated, timed_path

DT, MOST, ROUND = 0.01, 60_000, 0.05


def rates(positions):
    v = np.linalg.norm(np.diff(positions, axis=0), axis=1) / DT
    a = np.linalg.norm(np.diff(positions, 2, axis=0), axis=1) / DT**2
    return v, a


def test_a_line_is_a_trapezoid_of_speed():
    line = timed_path(np.array([[0.0, 0.0], [10.0, 0.0]]), 1.0, 0.5, ROUND, DT, MOST)
    v, a = rates(line)
    np.testing.assert_allclose(line[[0, -1]], [[0.0, 0.0], [10.0, 0.0]], atol=1e-9)
    assert v.max() == pytest.approx(1.0, rel=1e-3)
    assert a.max() <= 0.5 * 1.01
    assert v[0] < 0.01 and v[-1] < 0.01
    # L / v + v / a, and the mean, sqrt(8 * 0.05 / a)
    assert len(line) * DT == pytest.approx(10.0 / 1.0 + 1.0 / 0.5 + 0.894, abs=0.1)


def test_a_circle_is_slower_where_the_acceleration_across_it_says_so():
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    circle = timed_path(np.c_[np.cos(angle), np.sin(angle)] * 0.5, 2.0, 0.5, ROUND, DT, MOST)
    v, a = rates(circle)
    assert 0.8 * np.sqrt(0.5 * 0.5) <= v.max() <= np.sqrt(0.5 * 0.5) * 1.01
    assert a.max() <= 0.5 * np.sqrt(2.0) * 1.1
    off = np.abs(np.linalg.norm(circle, axis=1) - 0.5)
    assert off.max() < ROUND


def test_a_corner_is_rounded_near_it():
    corner = timed_path(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), 0.5, 0.5, ROUND, DT, MOST)
    away = np.min(np.linalg.norm(corner - [3.0, 0.0], axis=1))
    assert 0.01 < away < ROUND
    assert rates(corner)[1].max() < 1.0


def test_points_that_repeat_count_once():
    once, twice = (
        timed_path(np.array(points), 1.0, 1.0, ROUND, DT, MOST)
        for points in ([[0.0], [1.0], [2.0]], [[0.0], [0.0], [1.0], [1.0], [2.0], [2.0]])
    )
    np.testing.assert_array_equal(once, twice)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 30), st.integers(0, 2**31), st.floats(0.3, 3.0), st.floats(0.1, 3.0))
def test_any_path_ends_at_its_last_point_within_its_speed(count, seed, speed, acceleration):
    points = np.random.default_rng(seed).normal(size=(count, 2))
    found = timed_path(points, speed, acceleration, ROUND, DT, MOST)
    np.testing.assert_allclose(found[[0, -1]], points[[0, -1]], atol=1e-6)
    assert rates(found)[0].max() <= speed * (1.0 + 1e-6)
    assert np.isfinite(found).all()


@pytest.mark.parametrize(
    ('points', 'reason'),
    [
        ([[1.0, 1.0]] * 5, 'two different points or more, got 5, all the same'),
        ([[0.0, 0.0], [1e6, 0.0]], 'at most 60000 steps, 600 s'),
        ([[0.0, 0.0], [1e200, 0.0], [-1e308, 1e308]], 'finite'),
    ],
)
def test_what_is_no_path_is_refused(points, reason):
    with pytest.raises(ValueError, match=reason), np.errstate(over='ignore'):
        timed_path(np.array(points), 1.0, 1.0, ROUND, DT, MOST)


def test_the_heading_is_that_of_the_velocity_and_continuous():
    angle = np.linspace(0.0, 4.0 * np.pi, 2000)
    circle = np.c_[np.cos(angle), np.sin(angle)]
    found = headings(np.vstack(([circle[0]] * 10, circle, [circle[-1]] * 10)))
    assert np.abs(np.diff(found)).max() < 0.01
    np.testing.assert_allclose(found[10:-10], angle + 0.5 * np.pi, atol=0.01)
    assert not headings(np.zeros((5, 2))).any()


def test_values_are_joined_with_their_velocities_or_at_rest_at_the_ends():
    times = np.array([0.0, 1.0, 2.0])
    found = interpolated(times, np.array([[0.0], [1.0], [0.0]]), DT)[:, 0]
    assert found[100] == pytest.approx(1.0)
    assert abs(found[1] - found[0]) < 1e-3 and abs(found[-1] - found[-2]) < 1e-3
    line = interpolated(times, times[:, np.newaxis], DT, np.ones((3, 1)))[:, 0]
    np.testing.assert_allclose(line, np.arange(201) * DT, atol=1e-12)
