# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a filter on a part of a recording: likelihood, NIS and whiteness by sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt

import numpy as np
from scipy.special import ndtri

from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.linear.batched import factor, whitened

from .block import Block
from .likelihood import Likelihood

#: The probability that a consistent filter fails any check.
MISS = 1e-3
#: The smallest number of readings with which a sensor is judged.
_LEAST = 20


@dataclass(frozen=True)
class SensorJudgement:
    """The evaluation of the innovations of one sensor.

    Parameters
    ----------
    time
        Time of each reading in seconds after the first reading (N,).
    squares
        NIS of each reading divided by its degrees of freedom (N,).
    nis, nis_bounds
        Sum of the NIS divided by its degrees of freedom, which is 1 for a consistent filter, and
        its bounds.
    whiteness, white_bound
        Correlation of each normalised innovation with the next, and the bound of its magnitude.
    rejected
        Number of readings that the gates rejected.
    """

    time: Array
    squares: Array
    nis: float
    nis_bounds: tuple[float, float]
    whiteness: float
    white_bound: float
    rejected: int

    @property
    def judged(self) -> bool:
        """Whether the sensor has enough readings to judge."""
        return len(self.squares) >= _LEAST

    @property
    def consistent(self) -> bool:
        """Whether NIS and whiteness are within their bounds."""
        low, high = self.nis_bounds
        return low <= self.nis <= high and abs(self.whiteness) <= self.white_bound


@dataclass(frozen=True)
class Judgement:
    """The log-likelihood of a part of a recording (-inf if undefined), and its sensors."""

    log_likelihood: float
    count: int
    sensors: Mapping[str, SensorJudgement]

    @property
    def judged(self) -> bool:
        """Whether any sensor has enough readings to judge."""
        return any(sensor.judged for sensor in self.sensors.values())

    @property
    def consistent(self) -> bool:
        """Whether every sensor with enough readings is consistent."""
        return isfinite(self.log_likelihood) and all(
            sensor.consistent for sensor in self.sensors.values() if sensor.judged
        )


def judge(
    likelihood: Likelihood, values: Mapping[str, float], *after: int | None
) -> list[Judgement]:
    """Judge the filter with these values on the readings after each of several stamps.

    The filter runs once, from the start of the recording. A stamp of None selects all readings.
    """
    whole = replace(likelihood, until=None)
    try:
        with np.errstate(all='ignore'):
            blocks = list(whole.walk([likelihood.build(values)]).blocks())
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return [Judgement(-np.inf, 0, {}) for _ in after]
    return [_judge_blocks(whole, blocks, stamp) for stamp in after]


def _judge_blocks(whole: Likelihood, blocks: Sequence[Block], after: int | None) -> Judgement:
    """Judge the readings after a stamp."""
    first = whole.observations.span[0]
    columns: dict[str, list[tuple[Array, Array, int, Array]]] = {}
    total, count = 0.0, 0
    try:
        with np.errstate(all='ignore'):
            for block in blocks:
                use = np.ones(len(block.time), bool) if after is None else block.time > after
                if not use.any():
                    continue
                total += float(whole.terms(block)[use].sum())
                count += int(use.sum())
                if not whole.observations.readings[block.sensor].taken:
                    continue
                accepted = block.accepted[use, 0]
                E, S = block.innovation[use][accepted, 0], block.covariance[use][accepted, 0]
                z = whitened(factor(S), E)
                times = (block.time[use][accepted] - first) * 1e-9
                columns.setdefault(block.sensor, []).append(
                    (times, z, int((~accepted).sum()), np.sum(z * z, axis=1) / z.shape[1])
                )
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        total = -np.inf
    if not isfinite(total):
        return Judgement(-np.inf, count, {})
    checks = max(1, 2 * len(columns))
    return Judgement(
        total,
        count,
        {name: _judge_sensor(parts, MISS / checks) for name, parts in columns.items()},
    )


def _judge_sensor(
    parts: Sequence[tuple[Array, Array, int, Array]], miss: float
) -> SensorJudgement:
    width = max(z.shape[1] for _, z, _, _ in parts)
    time = np.concatenate([t for t, _, _, _ in parts])
    squares = np.concatenate([s for _, _, _, s in parts])
    order = np.argsort(time, kind='stable')
    # readings with missing values do not count for whiteness
    z = np.concatenate([z for _, z, _, _ in parts if z.shape[1] == width])
    degrees = sum(z.size for _, z, _, _ in parts)
    nis = float(sum(np.sum(z * z) for _, z, _, _ in parts) / max(degrees, 1))
    bounds = chi_square_bounds(1.0, 2.0 / max(degrees, 1), miss)
    power = float(np.sum(z * z))
    white = float(np.sum(z[1:] * z[:-1])) / power if power > 0.0 else 0.0
    bound = float(-ndtri(miss / 2.0)) / sqrt(max(z.size, 1))
    rejected = sum(r for _, _, r, _ in parts)
    return SensorJudgement(time[order], squares[order], nis, bounds, white, bound, rejected)
