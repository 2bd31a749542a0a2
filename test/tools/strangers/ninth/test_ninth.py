# SPDX-License-Identifier: Apache-2.0
"""Messages and a fault of the ninth set."""

from __future__ import annotations

import struct

import numpy as np

from ..messages import vectors
from ..simulation import Channel
from .messages import FORMS
from .recordings import misdated_from


def test_a_clock_is_set_from_a_time_on() -> None:
    time = np.arange(4.0)
    channel = Channel('a', 'speed', time, np.zeros((4, 1)), np.zeros((4, 1)), time.copy(), time)
    misdated_from(channel, np.random.default_rng(0), 2.0, 0.25)
    assert channel.stamp.tolist() == [0.0, 1.0, 2.25, 3.25]
    assert channel.received.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_the_last_number_of_the_reflectors_is_the_second_bearing() -> None:
    kind, form = FORMS['reflectors']
    message = form(0, (4.0, 0.1, 7.0, -0.2))
    assert kind == 'sensor_msgs/msg/JointState'
    assert b'bearing_b' in message
    assert struct.pack('<4d', 4.0, 0.1, 7.0, -0.2) in message


def test_the_torque_of_a_shaft_is_about_x() -> None:
    _, form = FORMS['twist_of_shaft']
    assert form(0, (2.5,)) == vectors('base_link', 6, 0, 1, 2, 3)(0, (0.0, 0.0, 0.0, 2.5))
