# SPDX-License-Identifier: Apache-2.0
"""Readings that are the input, moved from the place of their sensor to the centre of the body."""

from __future__ import annotations

from collections import deque

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.core.quantity import ACCELERATION, RATE, VELOCITY, quantity
from kalman_ros.core.rotations import cross

#: Nanoseconds between two readings beyond which their difference is no angular acceleration.
_APART = 500_000_000
#: Number of the last intervals, of which the longest is how long a reading is expected to be held.
_INTERVALS = 8


class InputPlace:
    """The place of an IMU, or of wheels, whose readings are the input.

    With r the place in the axes of the body, and w the angular rate, the velocity of the centre is
    v - w x r and its acceleration a - w' x r - w x (w x r) (J. J. Craig, Introduction to Robotics,
    sections 5.6 and 6.2). The angular acceleration w' of a reading is what the rate has changed by
    and earlier ones have not yet accounted for, while they were held, by the time that it is
    expected to be held. So w' adds up to the change of the rate, whatever the intervals, and its
    noise in a velocity stays near r times that of the rate. A rate that is not among the fields is
    0, and so is w' without stamps, and until the intervals are known. Readings with a scale stay
    those of their sensor: w has the scale of the rates, and what is added is divided by its own.

    Parameters
    ----------
    signal
        Signal of the input, with the ``place`` of its mounting.
    """

    def __init__(self, signal: Signal) -> None:
        self._place = np.array(signal.mounting.place)
        quantities = [quantity(field) for field in signal.fields]

        def of(kind: str) -> tuple[list[int], list[int]]:
            """Return the coordinates of a kind, and their axes."""
            pairs = [
                (k, component.axis)
                for k, component in enumerate(quantities)
                if component and component.kind == kind
            ]
            return [k for k, _ in pairs], [axis for _, axis in pairs]

        self._rates, self._velocities, self._accelerations = map(
            of, (RATE, VELOCITY, ACCELERATION)
        )
        self._scale = np.array(signal.mounting.scale or [1.0] * len(quantities))
        self._last = 0
        #: The rate up to which held readings have accounted for its change.
        self._reached: Array | None = None
        self._turning = np.zeros(3)
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)

    @property
    def matters(self) -> bool:
        """Whether a field is another one at another place."""
        return bool(self._velocities[0] or self._accelerations[0])

    def __call__(self, time: int | None, values: Array) -> Array:
        """Return the input (m,) at the centre of the body, for a reading at its place."""
        return self._moved(time, values, -1.0)

    def away(self, time: int | None, values: Array) -> Array:
        """Return the input (m,) at the place, for one at the centre: the inverse."""
        return self._moved(time, values, 1.0)

    def _moved(self, time: int | None, values: Array, sign: float) -> Array:
        rate = np.zeros(3)
        rate[self._rates[1]] = (self._scale * values)[self._rates[0]]
        self._follow(time, rate)
        swung = cross(rate, self._place)
        drawn = cross(self._turning, self._place) + cross(rate, swung)
        moved: Array = values.copy()
        for (index, axes), change in ((self._velocities, swung), (self._accelerations, drawn)):
            moved[index] += sign * change[axes] / self._scale[index]
        return moved

    def _follow(self, time: int | None, rate: Array) -> None:
        """Take the angular acceleration of a reading; that before holds for a late one."""
        if not time or not np.isfinite(rate).all():  # zero stands for no stamp
            return
        interval = time - self._last
        if self._reached is not None and -_APART <= interval <= 0:
            return
        self._last = time
        if self._reached is None or not 0 < interval <= _APART:
            self._reached, self._turning = rate, np.zeros(3)
            self._intervals.clear()
            return
        self._intervals.append(interval)
        self._reached = self._reached + self._turning * (interval * 1e-9)
        if len(self._intervals) == _INTERVALS:
            self._turning = (rate - self._reached) / (max(self._intervals) * 1e-9)


def at_centre(signal: Signal) -> InputPlace | None:
    """Return the place of a signal's sensor; None where readings are those of the centre."""
    place = InputPlace(signal) if any(signal.mounting.place) else None
    return place if place and place.matters else None
