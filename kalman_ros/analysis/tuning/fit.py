# SPDX-License-Identifier: Apache-2.0
"""A maximum likelihood fit: values, intervals, correlations, and what is not determined."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_gate

from .ascent import INTERRUPTED, LITTLE, Ascent, Report, _ignore, climb, maximum
from .identifiability import Determination, determination
from .intervals import reach
from .likelihood import Expansion, Likelihood
from .restricted import Restricted, restricted, unrestricted


@dataclass(frozen=True)
class Fitted:
    """A parameter after the fit.

    Parameters
    ----------
    name, unit
        Of the parameter.
    start, value
        Before and after the fit. Where it is not determined, ``value`` is one of many.
    low, high
        The 95 % interval; NaN where it is not determined.
    reason
        Why the data do not determine it; '' if they do.
    """

    name: str
    unit: str
    start: float
    value: float
    low: float
    high: float
    reason: str = ''

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return not self.reason


@dataclass(frozen=True)
class Fit:
    """A fit.

    Parameters
    ----------
    parameters
        In the order in which they were asked for.
    correlation
        Between their errors (p, p); NaN where one is not determined.
    before, after
        The log-likelihood at the start (-inf if there is none) and its maximum, without priors.
    rank
        The number of combinations of parameters that the data determine.
    count
        The numbers read that were fitted to.
    steps
        In how many steps the maximum was reached.
    stopped
        Why it was not; '' if it was.
    partial
        Whether only the first readings were fitted to, because of that.
    top
        The expansion at the fit.
    determination
        What it determines.
    """

    parameters: tuple[Fitted, ...]
    correlation: Array
    before: float
    after: float
    rank: int
    count: int
    steps: int
    stopped: str
    partial: bool
    top: Expansion
    determination: Determination

    @property
    def converged(self) -> bool:
        """Whether the maximum was reached."""
        return not self.stopped

    @property
    def interrupted(self) -> bool:
        """Whether somebody interrupted the fit."""
        return self.stopped == INTERRUPTED

    @property
    def complete(self) -> bool:
        """Whether it is a fit to all readings that nobody interrupted."""
        return not (self.partial or self.interrupted)

    @property
    def values(self) -> dict[str, float]:
        """The values by name; those that the data do not determine are one choice of many."""
        return {each.name: each.value for each in self.parameters}

    @property
    def aic(self) -> tuple[float, float]:
        """Akaike's information criterion, 2 p - 2 log L, before and after; lower is better."""
        return -2.0 * self.before, 2.0 * self.rank - 2.0 * self.after


def fit(likelihood: Likelihood, report: Report = _ignore) -> Fit:
    """Return the maximum likelihood fit, or with priors the likeliest values after the data.

    Noise is fitted by the restricted likelihood if other parameters are fitted, too. A fit that
    is interrupted returns what it has reached.

    Raises
    ------
    ValueError
        If there is nothing to fit, or no likelihood.
    KeyboardInterrupt
        If it is interrupted before anything was reached.
    """
    if not likelihood.parameters:
        raise ValueError('fit: expected at least one parameter, got none')
    ascent, end = _end(maximum(likelihood, report), report)
    first, likelihood = likelihood, ascent.likelihood
    start = ascent.before - likelihood.prior(likelihood.start)[0]
    top, found = end.top, end.found
    point, beyond = _settled(likelihood, top, found.seen)
    fitted = []
    for index, each in enumerate(likelihood.parameters):
        z, std, low, high = float(point[index]), float(found.std[index]), nan, nan
        if isfinite(std):
            below, above = reach(std, float(end.power[index]), float(end.freedom[index]))
            low, high = each.value(z - below), each.value(z + above)
        reason = beyond.get(index, found.reasons[index])
        fitted.append(Fitted(each.name, each.unit, each.start, each.value(z), low, high, reason))
    events = likelihood.observations.events({}, likelihood.until)
    count = sum(1 for event in events if event.order < len(likelihood.observations.readings))
    return Fit(
        tuple(fitted), found.correlation, start, max(ascent.top.data, top.data), found.rank,
        count, ascent.steps, ascent.stopped, likelihood is not first, top, found,
    )  # fmt: skip


def _end(ascent: Ascent, report: Report) -> tuple[Ascent, Restricted]:
    """Return an ascent, with its last step, and where a fit ends after it."""
    if not ascent.stopped:
        try:
            moved = restricted(ascent.likelihood, ascent.top, report)
            if moved is not None:
                return ascent, moved
            last = climb(ascent.likelihood, [ascent.top], report)[0]
            ascent = replace(
                ascent, top=last.top, steps=ascent.steps + last.steps, stopped=last.stopped
            )
        except KeyboardInterrupt:
            ascent = replace(ascent, stopped=INTERRUPTED)
    if not ascent.stopped:
        return ascent, unrestricted(ascent.likelihood, ascent.top)
    found = determination(ascent.likelihood.parameters, ascent.top.information, ascent.top.z)
    p = len(ascent.top.z)
    return ascent, Restricted(ascent.top, found, np.zeros(p), np.full(p, np.inf))


def _settled(likelihood: Likelihood, top: Expansion, seen: Any) -> tuple[Array, dict[int, str]]:
    """Return the point (p,) of a fit, and why some parameters are beyond what the data show.

    One that the data do not depend on is at its start, unless that is less likely: a noise may
    have become so small that all smaller ones are alike.
    """
    start, unseen = likelihood.start, np.flatnonzero(~seen).tolist()
    points = [np.where(np.arange(len(start)) == index, start, top.z) for index in unseen]
    values = likelihood.values(points) if points else np.zeros(0)
    point = top.z.copy()
    beyond: dict[int, str] = {}
    for index, value in zip(unseen, values):
        if value > top.value - LITTLE:
            point[index] = start[index]
        else:
            size = 'small' if top.z[index] < start[index] else 'large'
            beyond[index] = f'it is too {size} for these data to show it'
    return point, beyond


def sampled(
    likelihood: Likelihood, found: Fit, count: int, seed: int = 0
) -> list[dict[str, float]]:
    """Return values on the edge of the 95 % region, along each axis and in random directions.

    The region of r determined parameters is where (z - z0)' I (z - z0) is below the quantile of
    chi-square with r degrees of freedom; the others stay where they are.
    """
    known = np.array([each.determined for each in found.parameters])
    r = int(known.sum())
    if not r:
        return []
    P = found.determination.covariance[np.ix_(known, known)]
    values, vectors = np.linalg.eigh(P)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    directions = np.random.default_rng(seed).standard_normal((count, r))
    directions = np.concatenate((np.eye(r), -np.eye(r), directions))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    edge = np.sqrt(chi_square_gate(0.95, r)) * directions @ root.T
    result = []
    for away in edge:
        z = found.top.z.copy()
        z[known] += away
        pairs = zip(likelihood.parameters, z.tolist())
        result.append({each.name: each.value(at) for each, at in pairs})
    return result
