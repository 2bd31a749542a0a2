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
    assert history.at(2 * SECOND + 10**8, 0.1).translation[0] == 2.0
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


def test_a_way_of_several_transforms_is_their_product_at_the_earliest_stamp():
    history = FrameHistory('odom', 'base_link')
    add(history, ('base_footprint', 'base_link', turned(0.5, 0.0)), static=True)
    assert history.at(0, 1.0) is None
    wheels = ('wheel', 'spoke', turned(9.0, 1.0))
    add(history, wheels, ('odom', 'base_footprint', turned(2.0, np.pi / 2)))
    np.testing.assert_allclose(history.at(0, 0.0).translation, [2.0, 0.5, 0.0], atol=1e-12)
    # a frame between that moves, too: what was known of it before holds until its stamp
    lift = ('base_footprint', 'base_link', turned(0.7, 0.0))
    add(history, lift, time=SECOND)
    add(history, ('odom', 'base_footprint', turned(3.0, 0.0)), time=3 * SECOND)
    assert history.at(3 * SECOND, 1.9) is None
    np.testing.assert_allclose(history.at(SECOND, 0.0).translation, [3.7, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(history.at(3 * SECOND, 2.0).translation, [3.7, 0, 0], atol=1e-12)


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
    assert history.at(0, 1.0) is None and len(history._links) == 1000
