# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors: each changes the messages of one topic, or of several, in place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from .simulation import Array, Channel, Readings

Generator = np.random.Generator
Fault = Callable[[Readings, Generator], None]
#: All columns of the readings of a channel.
ALL = slice(None)


def on(name: str, change: Callable[..., None], *sizes: object, **options: object) -> Fault:
    """Return the fault that applies a change to the sensor with this name."""

    def fault(readings: Readings, rng: Generator) -> None:
        change(readings[name], rng, *sizes, **options)

    return fault


def both(*faults: Fault) -> Fault:
    """Return the fault that consists of others."""

    def fault(readings: Readings, rng: Generator) -> None:
        for part in faults:
            part(readings, rng)

    return fault


def clean(readings: Readings, rng: Generator) -> None:
    """Change nothing."""


def scaled(channel: Channel, rng: Generator, factor: float, columns: slice = ALL) -> None:
    """Multiply readings and their noise: a gain, a sign (-1), or other units."""
    channel.value[:, columns] *= factor
    channel.noise[:, columns] *= factor


def uneven(channel: Channel, rng: Generator, forward: float, backward: float) -> None:
    """Multiply what is above zero and what is below zero by different factors."""
    channel.value *= np.where(channel.value > 0.0, forward, backward)


def shifted(channel: Channel, rng: Generator, bias: float, columns: slice = ALL) -> None:
    """Add a constant."""
    channel.value[:, columns] += bias


def drifting(channel: Channel, rng: Generator, rate: float, columns: slice = ALL) -> None:
    """Add what grows by ``rate`` in a second."""
    channel.value[:, columns] += rate * channel.time[:, np.newaxis]


def quantised(channel: Channel, rng: Generator, step: float) -> None:
    """Round the readings, with their noise, to multiples of a step."""
    total = channel.value + channel.noise
    channel.value[:] = step * np.round(total / step)
    channel.noise[:] = 0.0


def about(axis: int, angle: float) -> Array:
    """Return the matrix that turns vectors about an axis, by the right hand."""
    c, s = math.cos(angle), math.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[first, first], turned[first, second] = c, -s
    turned[second, first], turned[second, second] = s, c
    return turned


def mounted(channel: Channel, rng: Generator, axis: float, degrees: float) -> None:
    """Turn the housing of an IMU on the robot: its axes see what others would have seen."""
    back = about(int(axis), math.radians(degrees)).T
    for triad in (slice(0, 3), slice(3, 6)):
        channel.value[:, triad] = channel.value[:, triad] @ back.T


def turned(channel: Channel, rng: Generator, degrees: float, begin: float, seconds: float) -> None:
    """Give places in the plane in a frame that is turned, for a stretch of time."""
    rows = (channel.time >= begin) & (channel.time < begin + seconds)
    spin = about(2, math.radians(degrees))[:2, :2]
    channel.value[rows] = channel.value[rows] @ spin.T


def swapped(channel: Channel, rng: Generator) -> None:
    """Exchange the two coordinates of a place: north and east in the wrong order."""
    channel.value[:] = channel.value[:, ::-1].copy()


def late(channel: Channel, rng: Generator, delay: float) -> None:
    """Stamp and send readings some time after they were taken."""
    channel.stamp += delay
    channel.received += delay


def rounded(channel: Channel, rng: Generator, step: float) -> None:
    """Round stamps to multiples of a step, downwards, as a clock of this resolution does."""
    channel.stamp[:] = step * np.floor(channel.stamp / step + 1e-9)


def batched(channel: Channel, rng: Generator, count: float, apart: float) -> None:
    """Stamp each group of messages when its first one is taken, ``apart`` from one another.

    They are received as before.
    """
    place = np.arange(len(channel.stamp)) % int(count)
    channel.stamp[:] = channel.stamp[np.arange(len(place)) - place] + apart * place


def lost(channel: Channel, rng: Generator, share: float) -> None:
    """Lose a share of the messages, each by itself."""
    channel.keep(rng.random(len(channel.time)) >= share)


def interrupted(channel: Channel, rng: Generator, begins: Sequence[float], length: float) -> None:
    """Lose all messages for ``length`` seconds from each of these times on."""
    kept = np.ones(len(channel.time), dtype=bool)
    for begin in begins:
        kept &= (channel.time < begin) | (channel.time >= begin + length)
    channel.keep(kept)


def frozen(channel: Channel, rng: Generator, begin: float, seconds: float) -> None:
    """Repeat the last reading before ``begin``, with new stamps."""
    rows = (channel.time >= begin) & (channel.time < begin + seconds)
    last = np.flatnonzero(channel.time < begin)[-1]
    channel.value[rows], channel.noise[rows] = channel.value[last], channel.noise[last]


def noisy(channel: Channel, rng: Generator, factor: float) -> None:
    """Multiply the noise, which the parameter file declares as before."""
    channel.noise *= factor


def all_noisy(factor: float) -> Fault:
    """Return the fault that multiplies the noise of every sensor."""

    def fault(readings: Readings, rng: Generator) -> None:
        for channel in readings.values():
            channel.noise *= factor

    return fault


def correlated(first: str, second: str, share: float) -> Fault:
    """Return the fault that gives two sensors noise with a common part, as large as before."""

    def fault(readings: Readings, rng: Generator) -> None:
        noise, other = readings[first].noise, readings[second].noise
        size = min(len(noise), len(other))
        mixed = share * noise[:size] + math.sqrt(1.0 - share**2) * other[:size]
        readings[second].noise[:size] = mixed

    return fault


def coloured(channel: Channel, rng: Generator, time: float) -> None:
    """Correlate the noise over a time constant in s, and keep its variance."""
    decay = np.exp(-np.diff(channel.time) / time)
    for k, share in enumerate(decay):
        fresh = math.sqrt(1.0 - share**2) * channel.noise[k + 1]
        channel.noise[k + 1] = share * channel.noise[k] + fresh


def outlying(channel: Channel, rng: Generator, share: float, size: float) -> None:
    """Add errors of ``size`` and of either sign to a share of the readings, each by itself."""
    rows = rng.random(len(channel.time)) < share
    channel.value[rows] += size * rng.choice([-1.0, 1.0], (rows.sum(), channel.value.shape[1]))


def displaced(channel: Channel, rng: Generator, begins: Sequence[float], length: float,
              offset: Sequence[float]) -> None:  # fmt: skip
    """Add an offset for ``length`` seconds from each of these times on: signals by detours."""
    for begin in begins:
        rows = (channel.time >= begin) & (channel.time < begin + length)
        channel.value[rows] += np.array(offset)


def disturbed(channel: Channel, rng: Generator, begin: float, seconds: float, size: float) -> None:
    """Add half a sine wave, as of iron that passes by a compass."""
    share = ((channel.time - begin) / seconds).clip(0.0, 1.0)
    channel.value += size * np.sin(np.pi * share)[:, np.newaxis]
