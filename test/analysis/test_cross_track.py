# SPDX-License-Identifier: Apache-2.0
"""Distances of positions from a path."""

import numpy as np

from kalman_ros.analysis.cross_track import cross_track

CORNER = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])


def test_distance_is_that_of_the_nearest_side():
    positions = np.array([[1.0, 0.5], [3.5, 2.0], [4.0, 0.0], [5.0, 1.0], [5.0, -1.0]])
    np.testing.assert_allclose(cross_track(CORNER, positions), [0.5, 0.5, 0.0, 1.0, np.sqrt(2.0)])


def test_beyond_the_ends_there_is_none():
    assert np.isnan(cross_track(CORNER, np.array([[-1.0, 0.2], [4.1, 3.5]]))).all()


def test_a_point_that_is_given_twice_does_not_count():
    twice = np.repeat(CORNER, 2, axis=0)
    positions = np.array([[1.0, 0.5], [4.5, 2.0]])
    np.testing.assert_array_equal(cross_track(twice, positions), cross_track(CORNER, positions))
