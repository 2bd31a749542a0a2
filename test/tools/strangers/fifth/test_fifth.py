# SPDX-License-Identifier: Apache-2.0
"""Rotations, messages and a fault of the fifth set."""

import math
import struct

import numpy as np
import pytest

from ..simulation import Channel
from .messages import FORMS
from .recordings import shaken
from .rotations import exponential, logarithm, product, rotated


def test_quaternions_turn_vectors_by_the_right_hand_and_have_logarithms() -> None:
    quarter = exponential((0.0, 0.0, 0.5 * math.pi))
    assert rotated(quarter, (1.0, 0.0, 0.0)) == pytest.approx([0.0, 1.0, 0.0])
    assert logarithm(product(quarter, quarter)) == pytest.approx([0.0, 0.0, math.pi])
    for vector in ((0.3, -2.0, 1.0), (0.0, 0.0, 0.0), (1e-10, 0.0, 0.0)):
        assert logarithm(exponential(vector)) == pytest.approx(vector)


def test_the_error_of_a_pose_is_a_turn_about_the_axes_of_the_map() -> None:
    half = math.pi / 2
    body = FORMS['pose'][1](0, [1.0, 2.0, 3.0, half, 0.0, 0.0, 0.0, 0.0, half])
    numbers = struct.unpack_from('<7d', body, len(body) - 7 * 8)
    assert numbers == pytest.approx([1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5])


def test_a_shaken_sensor_is_rough_for_a_stretch_alone() -> None:
    time = np.arange(6.0)
    ones = np.ones((6, 1))
    channel = Channel('a', 'range', time, ones.copy(), ones.copy(), time, time)
    shaken(channel, np.random.default_rng(0), 2.0, 2.0, 5.0)
    assert channel.noise[:, 0].tolist() == [1.0, 1.0, 5.0, 5.0, 1.0, 1.0]
