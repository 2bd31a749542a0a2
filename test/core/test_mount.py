# SPDX-License-Identifier: Apache-2.0
"""The mounting of a sensor: from its axes to those of the body, and of the world."""

import numpy as np
import pytest

from kalman_ros.core.mount import STRAIGHT, Mounting, mounting

EAST, NORTH, UP = np.eye(3)
QUARTER = 0.5 * np.pi


def test_north_east_down_are_places_in_another_order():
    R = Mounting(convention='ned').world_from_reported
    for reported, world in ((EAST, NORTH), (NORTH, EAST), (UP, -UP)):
        np.testing.assert_array_equal(R @ reported, world)


def test_forward_right_down_are_vectors_with_other_signs():
    R = Mounting(convention='ned').body_from_sensor
    np.testing.assert_array_equal(R, np.diag([1.0, -1.0, -1.0]))


def test_a_heading_turns_places_from_east_to_north():
    R = Mounting(heading=QUARTER).world_from_reported
    np.testing.assert_allclose(R @ EAST, NORTH, atol=1e-12)
    np.testing.assert_allclose(R @ NORTH, -EAST, atol=1e-12)
    both = Mounting(convention='ned', heading=QUARTER).world_from_reported
    np.testing.assert_allclose(both @ EAST, -EAST, atol=1e-12)  # reported to the north


def test_a_rotation_is_that_of_a_transform():
    R = mounting([0.0, 0.0, QUARTER], 'enu', '', [0.0] * 3).body_from_sensor
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    R = mounting([QUARTER, 0.0, 0.0], 'ned', '', [0.0] * 3).body_from_sensor
    np.testing.assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], atol=1e-12)


@pytest.mark.parametrize(
    ('options', 'turned', 'placed'),
    [
        ({}, False, False),
        ({'rotation': [0.0, 0.1, 0.0]}, True, True),
        ({'translation': [0.0, 0.0, 0.1]}, False, True),
        ({'convention': 'ned'}, True, False),
        ({'heading': -0.1}, True, False),
        ({'from_tf': True}, False, True),
        ({'frame': 'imu'}, False, False),
    ],
)
def test_a_mounting_is_turned_or_placed_by_its_options(options, turned, placed):
    given = {'rotation': [0.0] * 3, 'convention': 'enu', 'frame': '', 'translation': [0.0] * 3}
    found = mounting(**{**given, **options})
    assert (found.turned, found.placed) == (turned, placed)
    assert found.from_tf == options.get('from_tf', False)
    assert (found == STRAIGHT) is (not options)


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        ({'rotation': [0.0, 0.0]}, r'^mount\.rotation: expected roll, .* got \(0, 0\)'),
        ({'rotation': [0.0, np.nan, 0.0]}, r'^mount\.rotation: .* got \(0, nan, 0\)'),
        ({'convention': 'NED'}, "^convention: expected enu or ned, got 'NED'"),
        ({'frame': '/imu'}, "^frame: expected a name without a leading slash, got '/imu'"),
        ({'from_tf': True, 'rotation': [0.1, 0.0, 0.0]}, r'^mount\.tf: expected no'),
        ({'from_tf': True, 'translation': [0.1, 0.0, 0.0]}, r'^mount\.tf: expected no'),
    ],
)
def test_wrong_options_are_named(options, reason):
    given = {'rotation': [0.0] * 3, 'convention': 'enu', 'frame': '', 'translation': [0.0] * 3}
    with pytest.raises(ValueError, match=reason):
        mounting(**{**given, **options})
