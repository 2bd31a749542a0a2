# SPDX-License-Identifier: Apache-2.0
"""Sensors in sampled time, and the steps at which they read."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import lcm

from .sensor import Sensor


@dataclass(frozen=True)
class TimedSensor:
    """A sensor, its rate in Hz, and whether it is on."""

    sensor: Sensor
    rate: float
    enabled: bool = True


#: Shortest lag behind a command, in s; a shorter one is refused.
_SHORTEST_LAG = 1e-3


def following(command_time: float) -> float:
    """Return the rate in 1/s at which a lag of ``command_time`` in s approaches a command.

    Raises
    ------
    ValueError
        If the lag is below 1 ms.
    """
    if not command_time >= _SHORTEST_LAG:
        raise ValueError(
            f'command_time: expected 0 or at least {_SHORTEST_LAG:g} s, got {command_time:g}'
        )
    return 1.0 / command_time


#: Largest number of steps from one reading of a sensor to the next.
_SLOWEST = 10_000


def ratio(rate: float, loop_rate: float) -> Fraction:
    """Return the number of readings per step, at most one.

    Raises
    ------
    ValueError
        If the sensor is faster than the loop, or slower by a factor of more than 10 000.
    """
    slowest = loop_rate / _SLOWEST
    if not slowest <= rate <= loop_rate:
        raise ValueError(f'rate: expected {slowest:g} to {loop_rate:g} Hz, got {rate:g}')
    return Fraction(rate / loop_rate).limit_denominator(_SLOWEST)


def is_due(step: int, share: Fraction) -> bool:
    """Return whether a sensor with this ``share`` of the steps reads at ``step``."""
    n, d = share.numerator, share.denominator
    return step == 0 or step * n // d > (step - 1) * n // d


def period(shares: list[Fraction]) -> int:
    """Return the number of steps after which the pattern of readings repeats."""
    return lcm(*(share.denominator for share in shares))
