# SPDX-License-Identifier: Apache-2.0
"""Messages and the air of the eighth set."""

from __future__ import annotations

import numpy as np
import pytest

from ..simulation import Channel
from .recordings import north_first
from .vehicles import air_pressure


def test_the_pressure_of_the_air_falls_with_the_height() -> None:
    # the standard atmosphere at 0, 1000 and 5000 m
    pressures = air_pressure(np.array([0.0, 1000.0, 5000.0]))
    assert pressures == pytest.approx([101325.0, 89874.6, 54019.9], rel=1e-4)


def test_a_vector_by_north_first_has_its_axes_and_noise_exchanged() -> None:
    time = np.zeros(1)
    channel = Channel('a', 'velocity', time, np.array([[1.0, 2.0, 3.0]]),
                      np.array([[0.1, 0.2, 0.3]]), time, time)  # fmt: skip
    north_first(channel, np.random.default_rng(0))
    assert channel.value.tolist() == [[2.0, 1.0, -3.0]]
    assert channel.noise.tolist() == [[0.2, 0.1, -0.3]]
