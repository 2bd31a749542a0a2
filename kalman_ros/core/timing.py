# SPDX-License-Identifier: Apache-2.0
"""Sensors in sampled time: which of them reads at which step."""

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


def ratio(rate: float, loop_rate: float) -> Fraction:
    """Return how many readings a step brings, at most one.

    Raises
    ------
    ValueError
        If the sensor would be faster than the loop.
    """
    exact = Fraction(min(rate / loop_rate, 2.0)).limit_denominator(10_000)
    if not 0 < exact <= 1:
        raise ValueError(f'rate: expected more than 0 and at most {loop_rate:g} Hz, got {rate:g}')
    return exact


def is_due(step: int, share: Fraction) -> bool:
    """Tell whether a sensor that reads in this ``share`` of the steps reads at ``step``."""
    n, d = share.numerator, share.denominator
    return step == 0 or step * n // d > (step - 1) * n // d


def period(shares: list[Fraction]) -> int:
    """Return after how many steps the pattern of readings repeats."""
    return lcm(*(share.denominator for share in shares))
