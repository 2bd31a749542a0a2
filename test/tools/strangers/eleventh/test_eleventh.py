# SPDX-License-Identifier: Apache-2.0
"""Messages of the eleventh set, and what its vehicles and plants do."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ..second.vehicles import GRAVITY
from .messages import FORMS
from .systems import SYSTEMS


def test_bearings_are_positions_in_the_order_of_the_beacons() -> None:
    kind, form = FORMS['three_bearings']
    message = form(0, (0.5, -1.5, 3.0))
    assert kind == 'sensor_msgs/msg/JointState'
    assert struct.pack('<3d', 0.5, -1.5, 3.0) in message


def test_both_antennas_of_the_barge_are_as_far_apart_as_its_file_says() -> None:
    barge = SYSTEMS['barge']
    readings = barge.simulate(np.random.default_rng(2), {**barge.physics, 'seconds': 20.0})
    bow, stern = readings['bow'], readings['stern']
    near = np.abs(stern.time[:, np.newaxis] - bow.time).argmin(axis=1)
    apart = np.linalg.norm(bow.value[near, :2] - stern.value[:, :2], axis=1)
    # they are read up to a quarter of a second apart, at 3 m/s
    assert apart == pytest.approx(38.0, abs=1.0)


def test_the_machine_stands_nearly_upright_on_its_slope() -> None:
    skidder = SYSTEMS['skidder']
    readings = skidder.simulate(np.random.default_rng(3), {**skidder.physics, 'seconds': 5.0})
    forces = readings['imu'].value[:, 3:]
    assert np.linalg.norm(forces, axis=1) == pytest.approx(GRAVITY, abs=0.5)
    assert forces[:, 2].min() > 0.9 * GRAVITY


@pytest.mark.parametrize('moved', [0.0, 0.5])
def test_anchors_are_as_far_as_they_are_from_the_start(moved: float) -> None:
    backpack = SYSTEMS['backpack']
    physics = {**backpack.physics, 'seconds': 2.0, 'x_d': 7.0 + moved}
    readings = backpack.simulate(np.random.default_rng(4), physics)
    place = np.array([[8.0, 7.0, 4.5], [-7.0, 8.0, 0.6], [-8.0, -7.0, 5.0], [7.0 + moved, -8, 1]])
    expected = np.linalg.norm(place - [0.3, -0.4, 1.3], axis=1)
    assert readings['anchors'].value[0] == pytest.approx(expected, abs=0.7)
