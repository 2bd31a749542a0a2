# SPDX-License-Identifier: Apache-2.0
"""Whether estimates match their covariances, by NEES and NIS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.core.known_names import KnownNames
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.simulation.trajectory import Innovations, Trajectory

from . import text
from .accept import got, number, numbers
from .estimates import Estimates


@dataclass(frozen=True)
class ConsistencyCheck:
    """An average divided by its expectation, with the bounds of a consistent filter.

    Parameters
    ----------
    name
        The quantity tested.
    mean
        1 for a consistent filter.
    low, high
        Its bounds.
    count
        The number of values averaged.
    hint
        Likely causes if it is outside.
    """

    name: str
    mean: float
    low: float
    high: float
    count: int
    hint: str

    @property
    def passed(self) -> bool:
        """Whether it is within the bounds."""
        return self.low <= self.mean <= self.high


@dataclass(frozen=True, repr=False)
class ConsistencyReport(KnownNames):
    """All checks; it is true if all passed, and prints them.

    Parameters
    ----------
    checks
        Each test.
    """

    checks: tuple[ConsistencyCheck, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    def __bool__(self) -> bool:
        return self.passed

    def __repr__(self) -> str:
        good = sum(check.passed for check in self.checks)
        verdict = 'PASS' if self.passed else 'FAIL'
        lines = [f'{verdict}: {good} of {len(self.checks)} checks passed']
        cells = (
            [check.name, text.number(check.mean), f'{check.low:.3g} to {check.high:.3g}',
             str(check.count), 'ok' if check.passed else 'FAILS']
            for check in self.checks
        )  # fmt: skip
        lines += text.table(['', 'mean', 'allowed', 'values', ''], cells)
        for check in self.checks:
            lines += [] if check.passed else text.sentence(f'{check.name}: {check.hint}')
        return '\n'.join(lines)


def consistency(estimates: Any, truth: Any = None, *, miss: float = 0.001) -> ConsistencyReport:
    """Return whether errors and innovations match their covariances.

    Parameters
    ----------
    estimates
        From `filter` or `smooth`, or a run of `simulate` or of the nodes, or several of one kind:
        independent runs make a sharper test.
    truth
        The true states (N, n) at the times of the estimates, one array for each of several; runs
        have their own; a row with NaN is left out. Without it there is only the NIS.
    miss
        The probability that a consistent filter fails a check.

    Returns
    -------
    ConsistencyReport
        NEES, for the error, and the NIS of each sensor (Bar-Shalom, Li and Kirubarajan,
        Estimation with Applications to Tracking and Navigation, 2001, section 5.4). Errors in time
        are correlated; their bounds take that into account, by the autocorrelation of the NEES,
        which some hundred readings show. A few tens fail more often than by ``miss``.

    Raises
    ------
    ValueError
        If there is nothing to check, or shapes do not match.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> run = kr.simulate('mass_spring_damper_2d', seconds=20, seed=1)
    >>> kr.consistency(run).passed
    True
    """
    single = isinstance(estimates, (Estimates, Trajectory))
    runs = [estimates] if single else _listed('estimates', estimates)
    truths = (
        [truth] if single else [None] * len(runs) if truth is None else _listed('truth', truth)
    )
    if len(truths) != len(runs):
        raise ValueError(f'truth: expected {len(runs)} arrays, one a run, got {len(truths)}')
    if not 0.0 < number('miss', miss) < 1.0:
        raise ValueError(f'miss: expected a probability, got {miss:g}')
    errors = [scores for pair in zip(runs, truths) if (scores := _nees(*pair)) is not None]
    checks: list[ConsistencyCheck] = []
    if errors:
        degrees, count = _size(runs[0]), sum(map(len, errors))
        mean = float(np.concatenate(errors).mean()) / degrees
        variance = 2.0 / degrees * sum(map(_effective, errors)) / count**2
        checks.append(_check('NEES', mean, variance, count, miss, _HINTS))
    for name in runs[0].innovations:
        whole = _nis(name, [run.innovations[name] for run in runs], miss)
        checks += [] if whole is None else [whole]
    if not checks:
        raise ValueError('truth: expected the true states, for smoothed estimates have no NIS')
    return ConsistencyReport(tuple(checks))


#: Likely causes of a value that is too large, and of one that is too small.
_HINTS = (
    'errors are larger than claimed: suspect the model, a bias, or noise that is larger',
    'errors are smaller than claimed: the noise is probably smaller than configured',
)
_NIS_HINTS = (
    'innovations are larger than expected: suspect its noise, a bias, or the process noise',
    'innovations are smaller than expected: its noise is probably smaller than configured',
)


def _listed(name: str, given: Any) -> list[Any]:
    """Return the results of several runs, one or more."""
    try:
        several = list(given)
    except TypeError:
        raise ValueError(
            f'{name}: expected those of one run, or a list of several, got {got(given)}'
        ) from None
    if not several:
        raise ValueError(f'{name}: expected at least one run, got none')
    return several


def _size(run: Any) -> int:
    mean = run.mean if isinstance(run, Estimates) else run.estimate
    return int(mean.shape[1])


def _nees(run: Any, truth: Any) -> Array | None:
    """Return the NEES of a run (N,), None without the truth."""
    if isinstance(run, Trajectory):
        space = getattr(run, 'scenario', None)
        error = run.truth - run.estimate
        if space is not None:
            error = space.model.state.subtract(run.truth, run.estimate)
        return nees(error, run.covariance)
    if not isinstance(run, Estimates):
        raise ValueError(f'estimates: expected those of kr.filter, got {got(run)}')
    if truth is None:
        return None
    states = numbers('truth', truth)
    states = states.reshape(-1, 1) if states.ndim == 1 else states
    if states.shape != run.mean.shape:
        raise ValueError(f'truth: expected shape {run.mean.shape}, got {states.shape}')
    known = np.isfinite(run.std).all(axis=1) & np.isfinite(states).all(axis=1)
    if not known.any():
        raise ValueError('truth: expected a time at which truth and estimate are known, got none')
    error = run.state.subtract(states[known], run.mean[known])
    return nees(error, run.covariance[known])


def _effective(values: Array) -> float:
    """Return the variance of the sum of a correlated sequence, in variances of one value.

    The autocorrelation is summed as long as pairs of it are positive (C. Geyer, Practical Markov
    Chain Monte Carlo, Statistical Science 7(4), 1992).
    """
    mean, count = float(values.mean()), len(values)
    centred = values - mean
    spectrum = np.abs(np.fft.rfft(centred, 2 * count)) ** 2
    covariance = np.fft.irfft(spectrum)[:count] / count
    if not covariance[0] > 0.0:
        return float(count)
    pairs = covariance[: count // 2 * 2].reshape(-1, 2).sum(axis=1) / covariance[0]
    ends = np.flatnonzero(pairs <= 0.0)
    factor = max(1.0, 2.0 * float(pairs[: ends[0] if ends.size else None].sum()) - 1.0)
    return count * factor


def _check(
    name: str, mean: float, variance: float, count: int, miss: float, hints: tuple[str, str]
) -> ConsistencyCheck:
    low, high = chi_square_bounds(1.0, variance, miss)
    return ConsistencyCheck(name, mean, low, high, count, hints[0] if mean > high else hints[1])


def _nis(name: str, series: Sequence[Innovations], miss: float) -> ConsistencyCheck | None:
    """Return the check of a sensor's NIS, which is white in time; None without readings."""
    # a reading of which nothing was known has none
    judged = [np.isfinite(innovations.nis) for innovations in series]
    degrees = sum(
        int(np.isfinite(innovations.values[rows]).sum())
        for innovations, rows in zip(series, judged)
    )
    if not degrees:
        return None
    total = sum(float(np.nansum(innovations.nis)) for innovations in series)
    count = sum(int(rows.sum()) for rows in judged)
    return _check(f'NIS of {name}', total / degrees, 2.0 / degrees, count, miss, _NIS_HINTS)
