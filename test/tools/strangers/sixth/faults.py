# SPDX-License-Identifier: Apache-2.0
"""Further faults of sensors, in addition to those of the other sets."""

from __future__ import annotations

from ..faults import Fault, Generator
from ..simulation import Channel, Readings


def geared(channel: Channel, rng: Generator, play: float) -> None:
    """Follow readings behind a gear with play: nothing moves within it after a reversal."""
    column = channel.value[:, 0]
    at = column[0]
    for k, driven in enumerate(column.tolist()):
        at = min(max(at, driven - 0.5 * play), driven + 0.5 * play)
        column[k] = at


def failing(channel: Channel, rng: Generator, share: float, number: float) -> None:
    """Read a number that means an error in a share of the readings, each by itself."""
    rows = rng.random(len(channel.time)) < share
    channel.value[rows], channel.noise[rows] = number, 0.0


def jittering(channel: Channel, rng: Generator, std: float) -> None:
    """Stamp readings some random time after they were taken, and send them then."""
    delay = abs(rng.normal(0.0, std, len(channel.time)))
    channel.stamp += delay
    channel.received += delay


def unsteady(channel: Channel, rng: Generator, std: float) -> None:
    """Receive messages a random time after their stamps, which are right."""
    channel.received += abs(rng.normal(0.0, std, len(channel.time)))


def connected(first: str, second: str) -> Fault:
    """Return the fault that exchanges the readings of two sensors of equal rates."""

    def fault(readings: Readings, rng: Generator) -> None:
        one, other = readings[first], readings[second]
        one.topic, other.topic = other.topic, one.topic

    return fault
