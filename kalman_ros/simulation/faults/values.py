# SPDX-License-Identifier: Apache-2.0
"""Faults of what a sensor says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, TimedSensor, one_each

from .fault import Fault, Reading


class Bias(Fault):
    """Off by a constant."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        bias: Annotated[
            Sequence[float],
            About('constant error of each coordinate; one for all', live=True),
        ] = (0.0,),
    ) -> None:
        super().__init__(timed, random)
        self._bias = one_each('bias', bias, timed.sensor.output.size)

    def __call__(self, reading: Reading) -> Reading:
        """Return it with the bias."""
        return reading._replace(values=reading.values + self._bias)


class Creep(Fault):
    """Off by what grows from reading to reading; it begins at zero."""

    def __init__(self, timed: TimedSensor, random: np.random.Generator) -> None:
        super().__init__(timed, random)
        self._offset: Array = np.zeros(timed.sensor.output.size)
        self._last: int | None = None

    def growth(self, dt: float) -> Array:
        """Return by how much more (k,) it is off after ``dt`` seconds."""
        raise NotImplementedError

    def __call__(self, reading: Reading) -> Reading:
        """Return it with what has come together since the first."""
        if self._last is not None:
            self._offset = self._offset + self.growth((reading.time - self._last) * 1e-9)
        self._last = reading.time
        return reading._replace(values=reading.values + self._offset)


class Drift(Creep):
    """Off by a ramp."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        drift: Annotated[
            Sequence[float],
            About('growth of the error of each coordinate a second; one for all', live=True),
        ] = (0.0,),
    ) -> None:
        super().__init__(timed, random)
        self._slope = one_each('drift', drift, timed.sensor.output.size)

    def growth(self, dt: float) -> Array:
        """Return it in proportion to time."""
        return self._slope * dt


class RandomWalk(Creep):
    """Off by a random walk."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        random_walk: Annotated[
            Sequence[float],
            About(
                'standard deviation of what the error of each coordinate walks in a second; '
                'one for all',
                minimum=0.0,
                live=True,
            ),
        ] = (0.0,),
    ) -> None:
        super().__init__(timed, random)
        self._std = one_each('random_walk', random_walk, timed.sensor.output.size)

    def growth(self, dt: float) -> Array:
        """Return a step of variance in proportion to time."""
        return np.asarray(self._std * np.sqrt(dt) * self.random.standard_normal(self._std.size))


class Outliers(Fault):
    """Now and then far off."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        outliers: Annotated[
            float, About('probability that a reading is far off', '', 0.0, 1.0, live=True)
        ] = 0.0,
        outlier_size: Annotated[
            float,
            About('how far, in standard deviations of its noise; either way', '', 0.0, live=True),
        ] = 20.0,
    ) -> None:
        super().__init__(timed, random)
        self._probability = outliers
        self._size = outlier_size * np.sqrt(timed.sensor.covariance.diagonal())

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or far off, each coordinate either way."""
        signs = self.random.choice((-1.0, 1.0), self._size.size)
        if not self.happens(self._probability):
            return reading
        return reading._replace(values=reading.values + signs * self._size)


class Freeze(Fault):
    """Stuck at the first value, with new stamps."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        freeze: Annotated[
            bool, About('stuck at the value read when this begins, with new stamps', live=True)
        ] = False,
    ) -> None:
        super().__init__(timed, random)
        self._stuck: Array | None = None

    def __call__(self, reading: Reading) -> Reading:
        """Return it with the value of the first."""
        if self._stuck is None:
            self._stuck = reading.values
        return reading._replace(values=self._stuck)


class NotANumber(Fault):
    """Now and then no number at all."""

    def __init__(
        self,
        timed: TimedSensor,
        random: np.random.Generator,
        nan: Annotated[
            float, About('probability that a reading is not a number', '', 0.0, 1.0, live=True)
        ] = 0.0,
    ) -> None:
        super().__init__(timed, random)
        self._probability = nan

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or NaN in every coordinate."""
        if not self.happens(self._probability):
            return reading
        return reading._replace(values=np.full(reading.values.size, np.nan))
