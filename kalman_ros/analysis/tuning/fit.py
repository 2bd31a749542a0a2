# SPDX-License-Identifier: Apache-2.0
"""Maximum likelihood fit: values, intervals, correlations, and undetermined parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_gate

from .ascent import INTERRUPTED, LITTLE, Ascent, Report, _ignore, climb, maximum, towards_start
from .ends import ends
from .identifiability import ONE_SIDED, UNCERTAIN, Determination, determination
from .intervals import reach
from .likelihood import Expansion, Likelihood
from .restricted import Restricted, restricted, unrestricted


@dataclass(frozen=True)
class Fitted:
    """A parameter after the fit.

    Parameters
    ----------
    name, unit
        Name and unit of the parameter.
    start, value
        Value before and after the fit. If the parameter is not determined, ``value`` is one choice
        of many.
    low, high
        Ends of the 95 % interval, infinite where these data show no limit; NaN if the parameter
        shows only in combination with others, or if the maximum was not reached.
    reason
        Reason for which the data do not determine the parameter; '' if they do.
    """

    name: str
    unit: str
    start: float
    value: float
    low: float
    high: float
    reason: str = ''

    @property
    def interval(self) -> str:
        """The interval as text; '' if the data show no limit."""
        if isfinite(self.low) and isfinite(self.high):
            return f'{self.low:.4g} to {self.high:.4g}'
        if isfinite(self.low):
            return f'above {self.low:.4g}'
        return f'below {self.high:.4g}' if isfinite(self.high) else ''

    @property
    def determined(self) -> bool:
        """Whether the data determine the parameter."""
        return not self.reason


@dataclass(frozen=True)
class Fit:
    """The result of a fit.

    Parameters
    ----------
    parameters
        Fitted parameters, in the order in which they were chosen.
    correlation
        Correlations of their errors (p, p); NaN for a parameter that is not determined.
    before, after
        Log-likelihood at the start (-inf if there is none) and its maximum, without priors.
    rank
        Number of combinations of parameters that the data determine.
    count
        Number of readings that were fitted.
    steps
        Number of steps of the ascent.
    stopped
        Reason for which the maximum was not reached; '' if it was.
    partial
        Whether only the first readings were fitted, since the ascent ended there.
    top
        Expansion at the fit.
    determination
        Determination of the parameters by the data.
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
        """Whether the user interrupted the fit."""
        return self.stopped == INTERRUPTED

    @property
    def complete(self) -> bool:
        """Whether all readings were fitted without an interruption."""
        return not (self.partial or self.interrupted)

    @property
    def values(self) -> dict[str, float]:
        """Values by name; a value that the data do not determine is one choice of many."""
        return {fitted.name: fitted.value for fitted in self.parameters}

    @property
    def aic(self) -> tuple[float, float]:
        """Akaike's information criterion, 2 p - 2 log L, before and after; lower is better."""
        return -2.0 * self.before, 2.0 * self.rank - 2.0 * self.after


def fit(likelihood: Likelihood, report: Report = _ignore) -> Fit:
    """Return the maximum likelihood fit, or with priors the maximum a posteriori fit.

    Noise is fitted by the restricted likelihood if other parameters are fitted, too. A fit that
    is interrupted returns the best result until then.

    Raises
    ------
    ValueError
        If there is no parameter to fit, or no likelihood.
    KeyboardInterrupt
        If it is interrupted before there is a result.
    """
    if not likelihood.parameters:
        raise ValueError('fit: expected at least one parameter, got none')
    ascent, end = _finish(maximum(likelihood, report), report)
    requested, likelihood = likelihood, ascent.likelihood
    start = ascent.before - likelihood.prior(likelihood.start)[0]
    top, determined = end.top, end.found
    point, beyond = _place_unseen(likelihood, top, determined.seen)
    fitted, stopped = [], ascent.stopped
    for index, free in enumerate(likelihood.parameters):
        reason = beyond.get(index, determined.reasons[index])
        below = above = nan  # below the maximum there are no intervals about it
        if not ascent.stopped:
            try:
                below, above, reason = _interval(
                    likelihood, end, index, float(point[index]), reason, not stopped
                )
            except KeyboardInterrupt:
                stopped = INTERRUPTED
                below, above, reason = _interval(
                    likelihood, end, index, float(point[index]), reason, False
                )
        low = -inf if below == -inf else free.value(below)
        high = inf if above == inf else free.value(above)
        value = free.value(float(point[index]))
        fitted.append(Fitted(free.name, free.unit, free.start, value, low, high, reason))
    events = likelihood.observations.events({}, likelihood.until)
    count = sum(1 for event in events if event.order < len(likelihood.observations.readings))
    return Fit(
        tuple(fitted), determined.correlation, start, max(ascent.top.data, top.data),
        determined.rank, count, ascent.steps, stopped, likelihood is not requested, top,
        determined,
    )  # fmt: skip


def _finish(ascent: Ascent, report: Report) -> tuple[Ascent, Restricted]:
    """Finish an ascent, and return it with the maximum at which the fit ends."""
    if not ascent.stopped:
        try:
            corrected = restricted(ascent.likelihood, ascent.top, report)
            if corrected is not None:
                return ascent, corrected
            polished = climb(ascent.likelihood, [ascent.top], report)[0]
            ascent = replace(
                ascent,
                top=polished.top,
                steps=ascent.steps + polished.steps,
                stopped=polished.stopped,
            )
        except KeyboardInterrupt:
            ascent = replace(ascent, stopped=INTERRUPTED)
    if not ascent.stopped:
        return ascent, unrestricted(ascent.likelihood, ascent.top)
    determined = determination(ascent.likelihood.parameters, ascent.top.information, ascent.top.z)
    p = len(ascent.top.z)
    return ascent, Restricted(ascent.top, determined, np.zeros(p), np.full(p, np.inf))


def _interval(
    likelihood: Likelihood, end: Restricted, index: int, z: float, reason: str, profiled: bool
) -> tuple[float, float, str]:
    """Return the ends of an interval about z on the scale of the fit, and why it is open if it is.

    Those by the information are used where they are near, and otherwise those of the profile, if
    it may be computed.
    """
    width = float(end.found.widest[index])
    if not reason:
        std = float(end.found.std[index])
        below, above = reach(std, float(end.power[index]), float(end.freedom[index]))
        if max(below, above) <= width or not profiled:
            return z - below, z + above, ''
        reason = UNCERTAIN
    if end.found.combined[index] or not profiled:
        return nan, nan, reason
    low, high = ends(likelihood, end.top, index, width, z)
    farthest = width if likelihood.parameters[index].positive else inf
    if max(z - low, high - z) < farthest:
        reason = ''
    elif reason == UNCERTAIN and isfinite(low) != isfinite(high):
        reason = ONE_SIDED
    return low, high, reason


def _place_unseen(
    likelihood: Likelihood, top: Expansion, seen: Any
) -> tuple[Array, dict[int, str]]:
    """Return the point (p,) of a fit, and the reasons for which some parameters are out of range.

    A parameter on which the data do not depend is set to the value nearest to its start that is
    as likely. That is not the start of a noise that is too large there: smaller values are equally
    likely from some value on.
    """
    start, unseen = likelihood.start, np.flatnonzero(~seen).tolist()
    point = top.z.copy()
    beyond: dict[int, str] = {}
    for index in unseen:
        points, values = towards_start(likelihood, top.z, index)
        nearest = int(np.argmax(np.append(values > top.value - LITTLE, True)))
        point[index] = [*points[:, index], top.z[index]][nearest]
        if nearest:
            size = 'small' if top.z[index] < start[index] else 'large'
            beyond[index] = f'it is too {size} for these data to show it'
    return point, beyond


def sampled(likelihood: Likelihood, fit: Fit, count: int, seed: int = 0) -> list[dict[str, float]]:
    """Return values on the edge of the 95 % region, along each axis and in random directions.

    In the region of r determined parameters, (z - z0)' I (z - z0) is below the quantile of
    chi-square with r degrees of freedom. The other parameters keep their values.
    """
    known = np.array([fitted.determined for fitted in fit.parameters])
    r = int(known.sum())
    if not r:
        return []
    P = fit.determination.covariance[np.ix_(known, known)]
    values, vectors = np.linalg.eigh(P)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    directions = np.random.default_rng(seed).standard_normal((count, r))
    directions = np.concatenate((np.eye(r), -np.eye(r), directions))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    edge = np.sqrt(chi_square_gate(0.95, r)) * directions @ root.T
    result = []
    for offset in edge:
        z = fit.top.z.copy()
        z[known] += offset
        pairs = zip(likelihood.parameters, z.tolist())
        result.append({free.name: free.value(coordinate) for free, coordinate in pairs})
    return result
