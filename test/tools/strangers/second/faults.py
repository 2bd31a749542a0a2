# SPDX-License-Identifier: Apache-2.0
"""Further faults of sensors and inputs, in addition to those of the first set."""

from __future__ import annotations

import math

import numpy as np

from ..faults import ALL, Fault, Generator
from ..simulation import Channel, Readings


def saturated(channel: Channel, rng: Generator, low: float, high: float, column: int = 0) -> None:
    """Limit the readings of a column, with their noise, to a range."""
    total = channel.value[:, column] + channel.noise[:, column]
    channel.value[:, column] = total.clip(low, high)
    channel.noise[:, column] = 0.0


def dead(channel: Channel, rng: Generator, width: float) -> None:
    """Read zero within a width around zero, and the excess over the width outside it."""
    size = np.abs(channel.value)
    channel.value[:] = np.sign(channel.value) * (size - width).clip(0.0)


def muted(channel: Channel, rng: Generator, least: float) -> None:
    """Read zero without noise below a least value, as a pickup that needs some speed."""
    still = np.abs(channel.value) < least
    channel.value[still], channel.noise[still] = 0.0, 0.0


def early(channel: Channel, rng: Generator, delay: float) -> None:
    """Stamp and send messages some time before they take effect: an input that acts late."""
    channel.stamp -= delay
    channel.received -= delay


def misdated(channel: Channel, rng: Generator, offset: float) -> None:
    """Add an offset to the stamps and not to the times of reception: a clock that is wrong."""
    channel.stamp += offset


def fast_clock(channel: Channel, rng: Generator, rate: float) -> None:
    """Let the clock of the stamps gain ``rate`` seconds in a second."""
    channel.stamp += rate * channel.time


def delivered_in_blocks(channel: Channel, rng: Generator, seconds: float) -> None:
    """Receive messages with right stamps in blocks of this length, at the end of each."""
    end = seconds * (np.floor(channel.time / seconds) + 1.0)
    channel.received[:] = np.maximum(channel.received, end)


def thinned(channel: Channel, rng: Generator, every: int) -> None:
    """Keep one message out of ``every``: a lower rate."""
    channel.keep(np.arange(len(channel.time)) % every == 0)


def wandering(channel: Channel, rng: Generator, growth: float, columns: slice = ALL) -> None:
    """Add a random walk whose standard deviation grows by ``growth`` times the root of time."""
    part = channel.value[:, columns]
    step = np.sqrt(np.diff(channel.time, prepend=0.0))[:, np.newaxis]
    part += growth * np.cumsum(step * rng.standard_normal(part.shape), axis=0)


def lagging(channel: Channel, rng: Generator, time: float) -> None:
    """Let readings follow as a first-order lag with this time constant, before their noise."""
    follow = -np.expm1(-np.diff(channel.time) / time)
    for k, share in enumerate(follow):
        channel.value[k + 1] = (1.0 - share) * channel.value[k] + share * channel.value[k + 1]


def exchanged(channel: Channel, rng: Generator, first: int, second: int) -> None:
    """Exchange two columns."""
    for part in (channel.value, channel.noise):
        part[:, [first, second]] = part[:, [second, first]]


def tilted(
    channel: Channel, rng: Generator, degrees: float, begin: float = 0.0, seconds: float = math.inf
) -> None:
    """Turn the first two columns, a place in the plane, about the origin for a stretch of time."""
    rows = (channel.time >= begin) & (channel.time < begin + seconds)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    channel.value[rows, :2] = channel.value[rows, :2] @ np.array([[c, s], [-s, c]])


def shared(first: str, second: str, share: float, size: float) -> Fault:
    """Return the fault that gives the noise of two sensors a common part, matched by time.

    ``size`` is the standard deviation of the second by that of the first; both keep theirs.
    """

    def fault(readings: Readings, rng: Generator) -> None:
        one, other = readings[first], readings[second]
        near = np.abs(other.time[:, np.newaxis] - one.time).argmin(axis=1)
        rest = math.sqrt(1.0 - share**2)
        other.noise[:] = share * size * one.noise[near] + rest * other.noise

    return fault


def declared_noise(channel: Channel, rng: Generator, factor: float) -> None:
    """Divide the variances in the messages, the last column, so that noise is larger by this."""
    channel.value[:, -1] /= factor**2
