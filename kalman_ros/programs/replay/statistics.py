# SPDX-License-Identifier: Apache-2.0
"""Statistics of the readings and innovations of a replay, and checks of the filter."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, sqrt
from typing import Any

import numpy as np
from scipy.special import ndtri

from kalman_ros.analysis.checks import MISS, Check
from kalman_ros.bags.replayed import Replayed, SensorReplay
from kalman_ros.core import Array, Space
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.consistency import independent, nees
from kalman_ros.estimators.outcome import Outcome

#: Fewest values that are checked.
_LEAST = 20
#: Share of dropped readings above which a sensor fails, however good the rest is.
_MOST_DROPPED = 0.5
#: Longest lag of an autocorrelation.
LAGS = 20


@dataclass(frozen=True)
class SensorStatistics:
    """Statistics of one sensor.

    Parameters
    ----------
    received, fused, rejected, dropped
        Numbers of readings; those that cannot be decoded are dropped, too.
    rate
        Number of readings per second.
    gap
        Longest interval between two readings, in seconds.
    delay, slowest
        Median and 99 % quantile of the seconds from the stamp to the reception.
    nis
        Mean normalised innovation squared, divided by its expectation.
    accepted_nis
        Mean of those of accepted readings alone.
    whiteness
        Correlation of the normalised innovations with the next ones.
    count
        Number of innovations.
    """

    received: int
    fused: int
    rejected: int
    dropped: int
    rate: float
    gap: float
    delay: float
    slowest: float
    nis: float
    accepted_nis: float
    whiteness: float
    count: int


def statistics(sensor: SensorReplay) -> SensorStatistics:
    """Return the statistics of a sensor."""
    accepted = sensor.fused
    rejected = sum(n for o, n in sensor.counts.items() if o.value.startswith('rejected'))
    dropped = sum(n for o, n in sensor.counts.items() if o.value.startswith('dropped'))
    intervals = np.diff(sensor.received)
    duration = float(intervals.sum()) if len(intervals) else 0.0
    delays = sensor.received - sensor.stamp
    z = normalised_innovations(sensor)
    known = np.isfinite(sensor.nis)
    nis, taken = sensor.nis[known], sensor.nis[known & _accepted(sensor)]
    k = sensor.value.shape[1]
    return SensorStatistics(
        received=len(sensor.nis) + sensor.undecodable,
        fused=accepted,
        rejected=rejected,
        dropped=dropped + sensor.undecodable,
        rate=len(intervals) / duration if duration > 0.0 else nan,
        gap=float(intervals.max()) if len(intervals) else nan,
        delay=float(np.median(delays)) if len(delays) else nan,
        slowest=float(np.quantile(delays, 0.99)) if len(delays) else nan,
        nis=float(nis.mean()) / k if len(nis) else nan,
        accepted_nis=float(taken.mean()) / k if len(taken) else nan,
        whiteness=float(autocorrelation(z, 1)[0]) if len(z) > 1 else nan,
        count=len(nis),
    )


def _accepted(sensor: SensorReplay) -> Any:
    """Return which readings moved the estimate, as a mask (N,)."""
    accepted = {outcome.name for outcome in Outcome if outcome.accepted}
    return np.isin(sensor.outcome, list(accepted))


def normalised_innovations(sensor: SensorReplay) -> Array:
    """Return L^-1 v (M, m) for the finite innovations v, with S = L L'."""
    use = np.isfinite(sensor.nis)
    v, S = sensor.innovation[use], sensor.innovation_covariance[use]
    if not len(v):
        return np.asarray(v)
    whitened = np.linalg.solve(np.linalg.cholesky(S), v[..., np.newaxis])
    return np.asarray(whitened[..., 0])


def autocorrelation(z: Array, lags: int) -> Array:
    """Return the correlations (lags,) of vectors z (N, m) with the vectors 1, 2, ... later."""
    total = float(np.sum(z**2))
    return np.array(
        [np.sum(z[lag:] * z[:-lag]) / total if total else nan for lag in range(1, lags + 1)]
    )


def whiteness_bound(count: int, size: int, miss: float) -> float:
    """Return the bound of the correlation of ``count`` white vectors (size,)."""
    return float(-ndtri(miss / 2.0)) / sqrt(count * size)


def plane(space: Space) -> tuple[int, int] | None:
    """Return the indices of the coordinates x and y in metres; None if the state has none."""
    where = {name: index for index, name in enumerate(space.names)}
    if 'x' not in where or 'y' not in where:
        return None
    both = where['x'], where['y']
    return both if all(space.units[index] == 'm' for index in both) else None


@dataclass(frozen=True)
class Errors:
    """Statistics of truth minus estimate, where the truth is known.

    Parameters
    ----------
    rms
        Root mean square error of each state (n,).
    nees
        Mean normalised error squared, divided by its expectation.
    independent
        Number of independent errors with the same information.
    ate
        Root mean square distance in the plane, in metres; NaN without a plane.
    count
        Number of beliefs at whose time the truth is known.
    """

    rms: Array
    nees: float
    independent: float
    ate: float
    count: int


def errors(replayed: Replayed) -> Errors | None:
    """Return the errors of a replay; None without a truth at the times of the beliefs."""
    if replayed.truth is None:
        return None
    space, beliefs = replayed.scenario.model.state, replayed.beliefs
    truth = replayed.truth.at(replayed.scenario, beliefs.time)
    known = np.isfinite(truth).all(axis=1)
    if not known.any():
        return None
    error, P = space.subtract(truth[known], beliefs.mean[known]), beliefs.covariance[known]
    both = plane(space)
    try:
        z = np.linalg.solve(np.linalg.cholesky(P), error[..., np.newaxis])[..., 0]
        worth, mean = independent(z), float(np.mean(nees(error, P))) / space.size
    except np.linalg.LinAlgError:
        worth, mean = 1.0, nan
    return Errors(
        rms=np.sqrt(np.mean(error**2, axis=0)),
        nees=mean,
        independent=worth,
        ate=nan if both is None else float(np.sqrt(np.mean(np.sum(error[:, both] ** 2, axis=1)))),
        count=len(error),
    )


def checks(replayed: Replayed, error: Errors | None) -> list[Check]:
    """Check the innovations, and the errors if the truth is known.

    A consistent filter fails with at most the probability `MISS`, over all checks together. The
    innovations are white only with the gains of the least error (T. Kailath, IEEE Trans. Automatic
    Control 13(6), 1968), and are not expected to be so with those of placed poles.
    """
    kind = filter_class(replayed.scenario.filter)
    judged = {name for name, source in replayed.scenario.sensors.items() if source.judged}
    numbers = {
        name: statistics(sensor) for name, sensor in replayed.sensors.items() if name in judged
    }
    enough = {name: stats for name, stats in numbers.items() if stats.count >= _LEAST}
    miss = MISS / max(1, 2 * len(enough) + (error is not None))
    result = []
    for name, stats in enough.items():
        k = replayed.sensors[name].value.shape[1]
        variance = 2.0 / (k * stats.count)
        result.append(Check.ratio(f'NIS of {name} / {k}', stats.nis, variance, miss))
        if kind.optimal or kind.mixture:
            bound = whiteness_bound(stats.count, k, miss)
            whiteness = f'whiteness of {name}', '', 0.0, stats.whiteness, -bound, bound
            result.append(Check.within(*whiteness))
    for name, stats in numbers.items():
        share = stats.dropped / stats.received if stats.received >= _LEAST else 0.0
        if share > _MOST_DROPPED:
            result.append(Check.within(f'dropped of {name}', '', 0.0, share, 0.0, _MOST_DROPPED))
    if error is not None:
        n = replayed.scenario.model.state.size
        variance = 2.0 / (n * error.independent)
        result.append(Check.ratio(f'NEES / {n}', error.nees, variance, miss))
    return result


def unjudged(replayed: Replayed) -> dict[str, int]:
    """Return the sensors with too few innovations to judge, with their numbers of innovations."""
    return {
        name: statistics(sensor).count
        for name, sensor in replayed.sensors.items()
        if replayed.scenario.sensors[name].judged and statistics(sensor).count < _LEAST
    }


def largest_change(replayed: Replayed) -> tuple[str, float, float, float] | None:
    """Return the largest change of the estimate by smoothing, in standard deviations.

    The result is the state, the time in seconds, the change, and the change in standard deviations
    of the filter; it is None if nothing was smoothed.
    """
    smoothed, beliefs = replayed.smoothed, replayed.beliefs
    if smoothed is None or not len(smoothed.time) or not len(beliefs.time):
        return None
    order = np.argsort(beliefs.time, kind='stable')
    times = beliefs.time[order]
    at = np.clip(np.searchsorted(times, smoothed.time, side='right') - 1, 0, None)
    which = order[at]
    same = np.isclose(times[at], smoothed.time, rtol=0.0, atol=1e-9)
    if not same.any():
        return None
    space = replayed.scenario.model.state
    change = space.subtract(smoothed.mean[same], beliefs.mean[which[same]])
    std = beliefs.std[which[same]]
    sigmas = np.abs(change) / np.where(std > 0.0, std, np.inf)
    row, column = np.unravel_index(int(np.argmax(sigmas)), sigmas.shape)
    time, size = float(smoothed.time[same][row]), float(change[row, column])
    return space.label(space.names[int(column)]), time, size, float(sigmas[row, column])
