# SPDX-License-Identifier: Apache-2.0
"""What a fault of a sensor is: a map from readings on their way to readings on their way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, NamedTuple

import numpy as np

from kalman_ros.core import About, Array, TimedSensor


class Reading(NamedTuple):
    """A reading on its way from a sensor to its topic. Times are in nanoseconds.

    Parameters
    ----------
    time
        When it was taken, in the time of the plant.
    stamp
        What its message says of that.
    values
        What it reads (k,).
    arrivals
        When each copy of it arrives, in the time of the plant; empty if it is lost.
    """

    time: int
    stamp: int
    values: Array
    arrivals: tuple[int, ...]


class Fault(ABC):
    """One thing that may go wrong with the readings of a sensor.

    It sees every reading once, in the order in which they are taken, also those that are lost:
    so none shifts the random numbers of another. A subclass is a dataclass, whose fields are its
    options; it is off while the first of them is zero.
    """

    def of(self, timed: TimedSensor, random: np.random.Generator) -> Fault:
        """Return it, as that of a sensor, with random numbers of its own.

        Raises
        ------
        ValueError
            If its options do not suit the sensor.
        """
        self.timed, self.random = timed, random
        self.begin()
        return self

    def begin(self) -> None:  # noqa: B027, most need nothing
        """Take up what it needs to know of its sensor, and how it starts; nothing by default."""

    @abstractmethod
    def __call__(self, reading: Reading) -> Reading:
        """Return what becomes of a reading."""

    def happens(self, probability: float) -> bool:
        """Draw whether something of this ``probability`` happens."""
        return bool(self.random.random() < probability)


@dataclass(frozen=True)
class Window:
    """When faults act: from ``start`` until before ``end``, in seconds."""

    start: float
    end: float

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


def window(
    fault_window: Annotated[
        Sequence[float],
        About(
            'when faults act: from the first until before the second, since the start or ~/reset',
            's',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0, inf),
) -> Window:
    """Return when faults act; ValueError if that is no window."""
    if len(fault_window) != 2 or not fault_window[0] < fault_window[1]:
        raise ValueError(f'fault_window: expected a start before an end, got {[*fault_window]}')
    return Window(*fault_window)
