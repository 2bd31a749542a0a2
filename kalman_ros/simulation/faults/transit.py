# SPDX-License-Identifier: Apache-2.0
"""Faults on the way of a reading: lost, late, out of order, or twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About

from .fault import Fault, Reading


@dataclass
class Dropout(Fault):
    """Lost now and then, each by itself."""

    dropout: Annotated[
        float, About('probability that a reading is lost', '', 0.0, 1.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or lost."""
        return reading._replace(arrivals=()) if self.happens(self.dropout) else reading


@dataclass
class BurstLoss(Fault):
    """Lost in bursts: a Markov chain of a good and a bad state, in which all is lost.

    E. N. Gilbert, Capacity of a burst-noise channel, Bell System Technical Journal 39 (1960),
    with no loss in the good state. Of all readings p / (p + 1/L) are lost, where bursts begin
    with probability p and take L readings on average.
    """

    burst_loss: Annotated[
        float,
        About('probability that a burst of losses begins at a reading', '', 0, 1, live=True),
    ] = 0.0
    burst_length: Annotated[
        float, About('how many readings a burst takes on average', '', 1.0, live=True)
    ] = 10.0

    def begin(self) -> None:
        """Begin in the good state."""
        self._bad = False

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or lost while a burst goes on."""
        changes = self.happens(1.0 / self.burst_length if self._bad else self.burst_loss)
        self._bad ^= changes
        return reading._replace(arrivals=()) if self._bad else reading


@dataclass
class Delay(Fault):
    """Late by a constant."""

    delay: Annotated[
        float, About('how late readings come, with their own stamp', 's', 0.0, 10.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return it later."""
        return later(reading, self.delay)


@dataclass
class Jitter(Fault):
    """Late by a random time; one reading may overtake another."""

    jitter: Annotated[
        float,
        About('readings come late by up to this, evenly distributed', 's', 0, 10, live=True),
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return it later."""
        return later(reading, self.random.uniform(0.0, self.jitter))


@dataclass
class Reordering(Fault):
    """Now and then a reading comes after the one that follows it."""

    reordering: Annotated[
        float,
        About('probability that a reading comes after its successor', '', 0, 1, live=True),
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or held back until between the next and the one after."""
        held = 1.5 / self.timed.rate
        return later(reading, held) if self.happens(self.reordering) else reading


@dataclass
class Duplication(Fault):
    """Now and then twice."""

    duplication: Annotated[
        float, About('probability that a reading comes twice', '', 0.0, 1.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return it, or two of it."""
        if not self.happens(self.duplication):
            return reading
        return reading._replace(arrivals=2 * reading.arrivals)


def later(reading: Reading, seconds: float) -> Reading:
    """Return a reading all of whose copies come so much later."""
    shift = round(seconds * 1e9)
    return reading._replace(arrivals=tuple(time + shift for time in reading.arrivals))
