# SPDX-License-Identifier: Apache-2.0
"""The way of a body over time, by poses and by the transforms of others."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip('rclpy')

from static_frames import message

from kalman_ros.codecs.transform_list import transforms_in
from kalman_ros.pipeline.frames import Placement
from kalman_ros.pipeline.pose_history import FrameHistory, PoseHistory

SECOND = 1_000_000_000


def test_poses_are_interpolated_between_its_stamps():
    history = PoseHistory()
    assert history.at(0, 1.0) is None
    for k in range(3):
        turn = np.array([0.0, 0.0, 3.0 + 0.2 * k])
        history.add(k * SECOND, Placement(np.array([k, 0.0, 0.0]), turn))
    middle = history.at(SECOND // 2, 0.1)
    np.testing.assert_allclose(middle.translation, [0.5, 0.0, 0.0])
    turned = Rotation.from_rotvec(middle.rotation).as_euler('xyz')[2]
    assert turned == pytest.approx(3.1)
    # a quarter of the way from the second to the third
    assert history.at(5 * SECOND // 4, 0.1).translation == pytest.approx([1.25, 0.0, 0.0])
    assert history.at(-(10**8), 0.1).translation[0] == 0.0
    assert history.at(-2 * 10**8, 0.1) is None
    # it moves on, and turns, as before
    assert history.at(2 * SECOND + 10**8, 0.1).translation[0] == pytest.approx(2.1, abs=1e-3)
    assert history.at(2 * SECOND + 2 * 10**8, 0.1) is None
    history.add(0, Placement(np.zeros(3), np.zeros(3)))  # the clock went back
    assert history.at(2 * SECOND, 0.1) is None


def test_a_pose_of_the_same_time_replaces_the_earlier_one():
    history = PoseHistory()
    for x in (1.0, 2.0):
        history.add(SECOND, Placement(np.array([x, 0.0, 0.0]), np.zeros(3)))
    assert history.at(SECOND, 0.0).translation[0] == 2.0


def add(history, *transforms, static=False, time=0):
    history.add(transforms_in(message(*transforms, time=time)), static=static)


def turned(x, yaw):
    return (x, 0.0, 0.0, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))


def test_a_way_of_several_transforms_has_each_at_the_time():
    """A lift at 10 Hz on wheels at 50 Hz, both of which move."""
    history = FrameHistory('odom', 'base_link')
    add(history, ('spoke', 'wheel', turned(9.0, 1.0)))
    assert history.at(0, 1.0) is None
    for k in range(51):
        time = k * SECOND // 50
        add(history, ('odom', 'base_footprint', turned(2.0 + time / SECOND, 0.0)), time=time)
        if k % 5 == 0:
            lift = turned(0.5 + 0.1 * time / SECOND, 0.0)
            add(history, ('base_footprint', 'base_link', lift), time=time)
    for seconds in (0.0, 0.33, 0.97, 1.0):
        found = history.at(round(seconds * SECOND), 0.0).translation
        np.testing.assert_allclose(found, [2.5 + 1.1 * seconds, 0.0, 0.0], atol=1e-9)
    static = FrameHistory('odom', 'base_link')
    add(static, ('base_footprint', 'base_link', turned(0.5, 0.0)), static=True)
    add(static, ('odom', 'base_footprint', turned(2.0, np.pi / 2)))
    np.testing.assert_allclose(static.at(0, 0.0).translation, [2.0, 0.5, 0.0], atol=1e-12)
    # another parent, by another way
    add(static, ('deck', 'base_link', turned(0.0, 0.0)), ('odom', 'deck', turned(7.0, 0.0)))
    assert static.at(0, 0.0).translation[0] == 7.0


def test_another_parent_begins_a_new_way():
    history = FrameHistory('odom', 'base_link')
    add(history, ('odom', 'deck', turned(0.0, 0.0)), static=True)
    add(history, ('odom', 'base_link', turned(1.0, 0.0)))
    add(history, ('deck', 'base_link', turned(5.0, 0.0)), time=SECOND)
    assert history.at(SECOND // 2, 1.0).translation[0] == 5.0


def arc(seconds):
    """Return a pose on a circle at 1 m/s and 0.5 rad/s."""
    a = 0.5 * seconds
    return Placement(np.array([2 * np.sin(a), 2 * (1 - np.cos(a)), 0.0]), np.array([0.0, 0.0, a]))


def test_beyond_the_last_pose_the_body_moves_on_as_it_did():
    history = PoseHistory()
    for k in range(31):
        history.add(k * SECOND // 30, arc(k / 30))
    for late in (0.02, 0.3, 0.9):
        found, expected = history.at(round((1.0 + late) * SECOND), 1.0), arc(1.0 + late)
        np.testing.assert_allclose(found.translation, expected.translation, atol=1e-9)
        np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-6)


def test_a_pose_out_of_order_is_left_out():
    history = PoseHistory()
    for k in (0, 1, 2):
        history.add(k * SECOND // 10, arc(k / 10))
    history.add(SECOND // 10 + 1, arc(5.0))
    assert history.at(SECOND // 10, 0.0).translation == pytest.approx(arc(0.1).translation)


def test_a_way_that_is_static_holds_at_any_time():
    history = FrameHistory('odom', 'base_link')
    add(history, ('odom', 'base_link', turned(0.5, 0.0)), static=True)
    assert history.at(10**18, 0.0).translation[0] == 0.5
    add(history, ('odom', 'base_link', turned(0.6, 0.0)), time=SECOND)
    assert history.at(10**18, 1.0) is None


@pytest.mark.parametrize(
    'bad', [(np.nan, 0, 0, 0, 0, 0, 1), (0, 0, np.inf, 0, 0, 0, 1), (0, 0, 0, 0, 0, 0, 0)]
)
def test_a_transform_that_is_none_leaves_the_last_one(bad):
    history = FrameHistory('odom', 'base_link')
    add(history, ('odom', 'base_link', turned(0.5, 0.0)))
    add(history, ('odom', 'base_link', bad), time=SECOND)
    assert history.at(0, 0.0).translation[0] == 0.5
    assert history.at(SECOND, 0.5) is None


def test_loops_and_strangers_are_no_way():
    history = FrameHistory('odom', 'base_link')
    loop = ('a', 'base_link', turned(0, 0)), ('base_link', 'a', turned(0, 0))
    add(history, *loop, static=True)
    for k in range(2000):
        add(history, ('x', f'y{k}', turned(0, 0)))
    assert history.at(0, 1.0) is None and len(history._links) == 2002
