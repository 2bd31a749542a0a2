# SPDX-License-Identifier: Apache-2.0
"""The interface of sensor faults: a map from readings in transit to readings in transit."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, NamedTuple

import numpy as np

from kalman_ros.core import About, Array, TimedSensor


class Reading(NamedTuple):
    """A reading in transit from a sensor to its topic. Times are in nanoseconds.

    Parameters
    ----------
    time
        Plant time at which it was taken.
    stamp
        Stamp of its message.
    values
        Values (k,).
    arrivals
        Plant times at which its copies arrive; empty if it is lost.
    """

    time: int
    stamp: int
    values: Array
    arrivals: tuple[int, ...]


class Fault(ABC):
    """One kind of sensor fault.

    It processes every reading once, in the order in which they are taken, lost ones included,
    so that no fault shifts the random numbers of another. A subclass is a dataclass whose fields
    are its options; it is off while the first of them is zero.
    """

    def of(self, timed: TimedSensor, random: np.random.Generator) -> Fault:
        """Return the fault for a sensor, with an independent random stream.

        Raises
        ------
        ValueError
            If its options do not suit the sensor.
        """
        self.timed, self.random = timed, random
        self.begin()
        return self

    def begin(self) -> None:  # noqa: B027, most do not need it
        """Initialise from the sensor; nothing by default."""

    @abstractmethod
    def __call__(self, reading: Reading) -> Reading:
        """Return the reading after the fault."""

    def happens(self, probability: float) -> bool:
        """Draw an event of this ``probability``."""
        return bool(self.random.random() < probability)


@dataclass(frozen=True)
class Window:
    """Window in which faults act: from ``start`` up to, but not at, ``end``, in seconds."""

    start: float
    end: float

    def __contains__(self, time: float) -> bool:
        return self.start <= time < self.end


def window(
    fault_window: Annotated[
        Sequence[float],
        About(
            'start and end of the faults, in seconds since the start or ~/reset',
            's',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0, inf),
) -> Window:
    """Return the window in which faults act; ValueError if it is invalid."""
    if len(fault_window) != 2 or not fault_window[0] < fault_window[1]:
        raise ValueError(f'fault_window: expected a start before an end, got {[*fault_window]}')
    return Window(*fault_window)
