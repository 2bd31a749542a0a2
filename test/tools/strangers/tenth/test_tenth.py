# SPDX-License-Identifier: Apache-2.0
"""Messages, a fault and the drone of the tenth set."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ..messages import vectors
from ..second.vehicles import GRAVITY
from ..simulation import Channel
from .messages import FORMS
from .recordings import unplugged
from .systems import SYSTEMS


def test_what_is_unplugged_reads_its_noise() -> None:
    time = np.arange(3.0)
    noise = np.array([[0.1], [-0.2], [0.3]])
    channel = Channel('a', 'speed', time, np.ones((3, 1)), noise, time.copy(), time.copy())
    unplugged(channel, np.random.default_rng(0))
    assert (channel.value + channel.noise).tolist() == [[0.1], [-0.2], [0.3]]


def test_the_last_number_of_the_markers_is_the_third_elevation() -> None:
    kind, form = FORMS['markers']
    numbers = [0.5 * k for k in range(9)]
    message = form(0, numbers)
    assert kind == 'sensor_msgs/msg/JointState'
    assert message.index(b'range_a') < message.index(b'bearing_a') < message.index(b'elevation_c')
    assert struct.pack('<9d', *numbers) in message


def test_a_heading_that_is_reported_is_the_turn_about_z() -> None:
    _, form = FORMS['speed_and_heading']
    assert form(0, (9.0, 2.5)) == vectors('base_link', 6, 0, 1, 2, 3, 4, 5)(
        0, (9.0, 0.0, 0.0, 0.0, 0.0, 2.5)
    )


@pytest.mark.parametrize('moved', [0.0, 2.0])
def test_the_drone_is_nearly_level_and_sees_markers_where_they_are(moved: float) -> None:
    miner = SYSTEMS['miner']
    physics = {**miner.physics, 'seconds': 5.0, 'x_c': -6.0 + moved}
    readings = miner.simulate(np.random.default_rng(3), physics)
    assert abs(readings['input'].value[:, 5] - GRAVITY).max() < 2.0
    ranges = readings['markers'].value[0, ::3]
    # from where it starts, but for half a metre
    places = np.array([[13.0, 1.0, 3.0], [-4.0, 11.0, 1.0], [-6.0 + moved, -9.0, 4.0]])
    near = np.linalg.norm(places - [0.5, -0.5, 2.0], axis=1)
    assert ranges == pytest.approx(near, abs=0.8)
