# SPDX-License-Identifier: Apache-2.0
"""Transport faults: readings lost, late, out of order, or duplicated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About

from .fault import Fault, Reading


@dataclass
class Dropout(Fault):
    """Independent losses."""

    dropout: Annotated[
        float, About('probability that a reading is lost', '', 0.0, 1.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading, or lose it."""
        return reading._replace(arrivals=()) if self.happens(self.dropout) else reading


@dataclass
class BurstLoss(Fault):
    """Losses in bursts: a Markov chain of a good and a bad state, in which all readings are lost.

    E. N. Gilbert, Capacity of a burst-noise channel, Bell System Technical Journal 39 (1960),
    with no loss in the good state. Of all readings p / (p + 1/L) are lost, where bursts begin
    with probability p and take L readings on average.
    """

    burst_loss: Annotated[
        float, About('probability that a burst of losses begins at a reading', '', 0, 1, live=True)
    ] = 0.0
    burst_length: Annotated[
        float, About('average length of a burst in readings', '', 1.0, live=True)
    ] = 10.0

    def begin(self) -> None:
        """Start in the good state."""
        self._bad = False

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading, or lose it during a burst."""
        changes = self.happens(1.0 / self.burst_length if self._bad else self.burst_loss)
        self._bad ^= changes
        return reading._replace(arrivals=()) if self._bad else reading


@dataclass
class Delay(Fault):
    """A constant delay."""

    delay: Annotated[
        float, About('delay of the readings, which keep their stamps', 's', 0.0, 10.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading delayed."""
        return later(reading, self.delay)


@dataclass
class Jitter(Fault):
    """A random delay; one reading may overtake another."""

    jitter: Annotated[
        float, About('largest delay of the readings, uniformly distributed', 's', 0, 10, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading delayed."""
        return later(reading, self.random.uniform(0.0, self.jitter))


@dataclass
class Reordering(Fault):
    """A reading sometimes arrives after its successor."""

    reordering: Annotated[
        float, About('probability that a reading arrives after its successor', '', 0, 1, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading, or delay it until between the next two."""
        held = 1.5 / self.timed.rate
        return later(reading, held) if self.happens(self.reordering) else reading


@dataclass
class Duplication(Fault):
    """A reading sometimes arrives twice."""

    duplication: Annotated[
        float, About('probability that a reading arrives twice', '', 0.0, 1.0, live=True)
    ] = 0.0

    def __call__(self, reading: Reading) -> Reading:
        """Return the reading once or twice."""
        if not self.happens(self.duplication):
            return reading
        return reading._replace(arrivals=2 * reading.arrivals)


def later(reading: Reading, seconds: float) -> Reading:
    """Return a reading with all copies delayed by ``seconds``."""
    shift = round(seconds * 1e9)
    return reading._replace(arrivals=tuple(time + shift for time in reading.arrivals))
