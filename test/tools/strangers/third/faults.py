# SPDX-License-Identifier: Apache-2.0
"""Further faults of sensors and inputs, in addition to those of the other sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..faults import ALL, Generator
from ..simulation import Channel


def crossed(channel: Channel, rng: Generator, source: int, target: int, share: float) -> None:
    """Add a share of one column to another: axes that are not at right angles."""
    channel.value[:, target] += share * channel.value[:, source]


def shifted_from(
    channel: Channel, rng: Generator, begin: float, bias: float, columns: slice = ALL
) -> None:
    """Add a constant from a time on."""
    channel.value[channel.time >= begin, columns] += bias


def slipping(
    channel: Channel, rng: Generator, begins: Sequence[float], length: float, factor: float
) -> None:
    """Multiply the readings for ``length`` seconds from each of these times on."""
    for begin in begins:
        rows = (channel.time >= begin) & (channel.time < begin + length)
        channel.value[rows] *= factor


def magnetised(channel: Channel, rng: Generator, size: float) -> None:
    """Add to a heading the error by iron on the vehicle, a sine of the heading."""
    channel.value[:] += size * np.sin(channel.value)


def limited(channel: Channel, rng: Generator, most: float) -> None:
    """Limit the size of the readings of all columns, with their noise."""
    channel.value[:] = (channel.value + channel.noise).clip(-most, most)
    channel.noise[:] = 0.0


def repeated(channel: Channel, rng: Generator, share: float) -> None:
    """Send a share of the messages again, 5 ms later and with the same stamp."""
    again = np.flatnonzero(rng.random(len(channel.time)) < share)
    for name in ('time', 'value', 'noise', 'stamp', 'received'):
        part = getattr(channel, name)
        setattr(channel, name, np.concatenate((part, part[again])))
    channel.received[len(channel.time) - len(again) :] += 0.005
