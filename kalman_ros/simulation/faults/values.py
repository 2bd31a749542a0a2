# SPDX-License-Identifier: Apache-2.0
"""Faults of the values of a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, one_each

from .fault import Fault, Reading


@dataclass
class Bias(Fault):
    """A constant error."""

    bias: Annotated[
        Sequence[float], About('constant error of each coordinate; one for all', live=True)
    ] = (0.0,)

    def begin(self) -> None:
        """Expand one number to all coordinates."""
        self._bias = one_each('bias', self.bias, self.timed.sensor.output.size)

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading with the bias."""
        return reading._replace(values=reading.values + self._bias)


class Creep(Fault):
    """An error that grows from zero, reading by reading."""

    def begin(self) -> None:
        """Start at zero."""
        self._offset: Array = np.zeros(self.timed.sensor.output.size)
        self._last: int | None = None

    def growth(self, dt: float) -> Array:
        """Return the growth (k,) of the error in ``dt`` seconds."""
        raise NotImplementedError

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading with the accumulated error."""
        if self._last is not None:
            self._offset = self._offset + self.growth((reading.time - self._last) * 1e-9)
        self._last = reading.time
        return reading._replace(values=reading.values + self._offset)


@dataclass
class Drift(Creep):
    """An error that grows linearly."""

    drift: Annotated[
        Sequence[float],
        About('growth rate of the error of each coordinate; one for all', live=True),
    ] = (0.0,)

    def begin(self) -> None:
        """Expand one number to all coordinates."""
        super().begin()
        self._slope = one_each('drift', self.drift, self.timed.sensor.output.size)

    def growth(self, dt: float) -> Array:
        """Return a growth proportional to time."""
        return self._slope * dt


@dataclass
class RandomWalk(Creep):
    """An error that is a random walk."""

    random_walk: Annotated[
        Sequence[float],
        About(
            'standard deviation of the random walk of each coordinate after one second; '
            'one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (0.0,)

    def begin(self) -> None:
        """Expand one number to all coordinates."""
        super().begin()
        self._std = one_each('random_walk', self.random_walk, self.timed.sensor.output.size)

    def growth(self, dt: float) -> Array:
        """Return a step with variance proportional to time."""
        return np.asarray(self._std * np.sqrt(dt) * self.random.standard_normal(self._std.size))


@dataclass
class Outliers(Fault):
    """Occasional large errors."""

    outliers: Annotated[
        float, About('probability that a reading is far off', '', 0.0, 1.0, live=True)
    ] = 0.0
    outlier_size: Annotated[
        float,
        About('size, in standard deviations of the noise, of either sign', '', 0.0, live=True),
    ] = 20.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading, or an outlier with independent signs."""
        std = np.sqrt(self.timed.sensor.covariance.diagonal())
        signs = self.random.choice((-1.0, 1.0), std.size)
        if not self.happens(self.outliers):
            return reading
        return reading._replace(values=reading.values + signs * self.outlier_size * std)


@dataclass
class Freeze(Fault):
    """Readings stuck at the first value, with new stamps."""

    freeze: Annotated[
        bool, About('stuck at the value read when this begins, with new stamps', live=True)
    ] = False

    def begin(self) -> None:
        """Start unstuck."""
        self._stuck: Array | None = None

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading with the value of the first reading."""
        if self._stuck is None:
            self._stuck = reading.values
        return reading._replace(values=self._stuck)


@dataclass
class NotANumber(Fault):
    """Occasional NaN."""

    nan: Annotated[
        float, About('probability that a reading is not a number', '', 0.0, 1.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading, or NaN in every coordinate."""
        if not self.happens(self.nan):
            return reading
        return reading._replace(values=np.full(reading.values.size, np.nan))
