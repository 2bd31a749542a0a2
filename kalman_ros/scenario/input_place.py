# SPDX-License-Identifier: Apache-2.0
"""Readings that are the input, moved from the place of their sensor to the centre of the body."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.core.quantity import ACCELERATION, RATE, VELOCITY, quantity
from kalman_ros.core.rotations import cross

#: Nanoseconds between two readings beyond which their difference is no angular acceleration.
_APART = 500_000_000


class InputPlace:
    """The place of an IMU, or of wheels, whose readings are the input.

    With r the place in the axes of the body, and w the angular rate, the velocity of the centre is
    v - w x r and its acceleration a - w' x r - w x (w x r) (J. J. Craig, Introduction to Robotics,
    sections 5.6 and 6.2). The angular acceleration w' is the difference of the rates of two
    readings by their time: its noise adds up to no more than r times that of the rate in a
    velocity. A rate that is not among the fields is 0.

    Parameters
    ----------
    signal
        Signal of the input, with the ``place`` of its mounting.
    """

    def __init__(self, signal: Signal) -> None:
        self._place = np.array(signal.mounting.place)
        found = [quantity(field) for field in signal.fields]

        def of(kind: str) -> tuple[list[int], list[int]]:
            """Return the coordinates of a kind, and their axes."""
            pairs = [(k, each.axis) for k, each in enumerate(found) if each and each.kind == kind]
            return [k for k, _ in pairs], [axis for _, axis in pairs]

        self._rates, self._velocities, self._accelerations = map(
            of, (RATE, VELOCITY, ACCELERATION)
        )
        self._last: tuple[int, Array] | None = None
        self._turning = np.zeros(3)

    @property
    def matters(self) -> bool:
        """Whether a field is another one at another place."""
        return bool(self._velocities[0] or self._accelerations[0])

    def __call__(self, time: int | None, values: Array) -> Array:
        """Return the input (m,) at the centre of the body, for a reading at its place."""
        rate = np.zeros(3)
        rate[self._rates[1]] = values[self._rates[0]]
        self._follow(time, rate)
        swung = cross(rate, self._place)
        drawn = cross(self._turning, self._place) + cross(rate, swung)
        moved: Array = values.copy()
        for (index, axes), change in ((self._velocities, swung), (self._accelerations, drawn)):
            moved[index] -= change[axes]
        return moved

    def _follow(self, time: int | None, rate: Array) -> None:
        """Take the angular acceleration from two readings; that before holds for a late one."""
        if time is None or not np.isfinite(rate).all():
            return
        if self._last is not None:
            before, old = self._last
            apart = time - before
            if -_APART <= apart <= 0:
                return
            near = 0 < apart <= _APART
            self._turning = (rate - old) / (apart * 1e-9) if near else np.zeros(3)
        self._last = time, rate


def at_centre(signal: Signal) -> InputPlace | None:
    """Return the place of a signal's sensor; None where readings are those of the centre."""
    place = InputPlace(signal) if any(signal.mounting.place) else None
    return place if place and place.matters else None
