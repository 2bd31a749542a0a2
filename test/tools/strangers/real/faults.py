# SPDX-License-Identifier: Apache-2.0
"""Further faults of sensors, for readings whose own noise is unknown."""

from __future__ import annotations

from collections.abc import Sequence

from ..faults import ALL, Generator, about
from ..simulation import Channel


def hissing(channel: Channel, rng: Generator, size: float, columns: slice = ALL) -> None:
    """Add white noise of this standard deviation."""
    part = channel.value[:, columns]
    part += size * rng.standard_normal(part.shape)


def offset(channel: Channel, rng: Generator, biases: Sequence[float]) -> None:
    """Add a constant to each column."""
    channel.value += biases


def spun(channel: Channel, rng: Generator, axis: int, radians: float) -> None:
    """Turn the housing of a sensor of one vector: its axes see what others would have seen."""
    channel.value[:] = channel.value @ about(axis, radians)
