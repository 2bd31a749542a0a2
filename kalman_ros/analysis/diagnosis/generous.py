# SPDX-License-Identifier: Apache-2.0
"""Causes that hide behind generous noise, by passes of the filter.

Where a noise is declared much larger than it is, the likelihood hardly shows what is wrong, and a
cause whose correction leaves small errors gains little by it. There the covariances S of the
innovations are taken to be known up to a factor for each coordinate, which is fitted: a likelihood
that is concentrated with respect to it has N log(mean of the squares) in place of the sum of the
squares (A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, Cambridge
1989, section 3.4.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache, partial
from itertools import permutations
from math import exp, inf, log, pi

import numpy as np

from kalman_ros.core import Array, rotations
from kalman_ros.sensors.landmarks import Landmarks

from . import input_axes
from .evidence import Evidence
from .examination import Examination
from .filter_pass import passage
from .finding import Finding
from .lateness import TimeSearch, shift_stamps, stamped
from .mounting import axes_exchanged, turned, vectors
from .passage import DROPPED, Passage, in_both
from .peak import deviation, peak
from .trials import certainty, same
from .units import groups, mixed, scaled, scaling

#: A noise is generous if the mean square of whitened innovations is below this.
_GENEROUS = 0.25
#: A cause is clear if it gains this for each value, which is a tenth of the errors; its certainty
#: is limited, since the noise of the filter is wrong.
_CLEAR, _MOST = 0.2, 0.8
#: Number of events on which causes are compared, and of those that determine a rotation.
_PART, _BEGINNING = 3000, 500
#: Factors at which the search of a scale begins, and the ratio of its first interval.
_FACTORS, _RATIO = (-2.0, -1.0, -0.5, 0.5, 2.0), 1.6
#: Largest relative deviation of a scale: a factor of zero leaves no errors of a sensor, either.
_KNOWN = 0.2
#: Rotations by one to three quarter turns about each axis, the first ones about z.
_QUARTERS = [
    rotations.exp(quarters * 0.5 * pi * axis) for axis in np.eye(3)[::-1] for quarters in (1, 2, 3)
]
#: Times in s at which that of wrong stamps begins.
_TIMES = (-0.05, 0.05)
#: Squares of whitened innovations are limited to this multiple of their mean, by the median.
_OUTLYING, _MEDIAN = 25.0, 0.455


def find(case: Examination, tried: Iterable[Finding]) -> Finding | None:
    """Return the cause that leaves the smallest errors, if one is clear.

    Parameters
    ----------
    case
        Recording.
    tried
        Causes that are known, which compete: noise that is corrected makes errors smaller, too.
    """
    if not _is_generous(case.passage):
        return None
    errors = _Errors(case)
    causes = [errors.judged(cause) for cause in (*tried, *_candidates(case, errors))]
    best = max(causes, key=lambda cause: cause.gain, default=None)
    if best is None or best.gain < _CLEAR * errors.values:
        return None
    rivals = [cause.gain for cause in causes if not same(cause, best)]
    ratio = len(case.passage.events) / errors.events
    return replace(
        best, gain=ratio * best.gain, z=(ratio * best.gain) ** 0.5, is_exact=True,
        certainty=min(certainty(best.gain, rivals), _MOST), most=_MOST,
    )  # fmt: skip


def _is_generous(whole: Passage) -> bool:
    """Return whether the errors of a coordinate are much smaller than the filter expects."""
    return any((_mean_squares(whole.whitened_of(name)) < _GENEROUS).any() for name in whole.names)


class _Errors:
    """Errors of a filter on the beginning of a recording, and how much smaller others are."""

    def __init__(self, case: Examination) -> None:
        self._case, self._before = case, case.passage.first(_PART)
        #: Number of events, and of values that are read.
        self.events = len(self._before.events)
        self.values = int(self._before.sizes.sum())
        self._until = float(self._before.series('time')[-1])

    def gain(self, evidence: Evidence) -> float:
        """Return by how much the concentrated likelihood of another recording is larger.

        Readings that the other one lacks have the expected errors, and a price each.
        """
        try:
            after = passage(evidence, self._until)
        except (ValueError, np.linalg.LinAlgError):
            return -inf
        return gain(self._before, after)

    def count(self, name: str) -> int:
        """Return the number of readings of a sensor."""
        return len(self._before.of(name))

    def judged(self, finding: Finding) -> Finding:
        """Return a finding with its gain."""
        assert finding.mended is not None
        dues = finding.dues * self.events / len(self._case.passage.events)
        cost = log(max(self.values, 2)) * finding.parameters
        return replace(finding, gain=self.gain(finding.mended()) - dues - cost)


def gain(before: Passage, after: Passage) -> float:
    """Return the reduction of the concentrated misfit by a correction, as `passage.explained`."""
    total = 0.0
    for name in before.names:
        old, new = before.terms(name), after.terms(name)
        if not len(new.index):
            return -inf
        squares = _mean_squares(before.whitened_of(name)), _mean_squares(after.whitened_of(name))
        total += len(old.index) * float(np.log(squares[0] / squares[1]).sum())
        in_new, in_old = in_both(old, new)
        total += float(old.log[in_new].sum() - new.log[in_old].sum())
        total -= DROPPED * int(np.sum(~in_new))
    return total


def misfit(whole: Passage) -> float:
    """Return the concentrated misfit of a pass, except for a constant."""
    total = 0.0
    for name in whole.names:
        whitened = whole.whitened_of(name)
        total += float(whole.series('log', name).sum())
        total += len(whitened) * float(np.log(_mean_squares(whitened)).sum())
    return total


def _mean_squares(whitened: Array) -> Array:
    """Return the mean square of each coordinate (k,) of whitened innovations, outliers limited."""
    squares = whitened**2
    most = np.median(squares, axis=0) * (_OUTLYING / _MEDIAN)
    limited = np.minimum(squares, np.where(most > 0.0, most, inf))
    return np.asarray(limited.mean(axis=0) + 1e-12)


def _candidates(case: Examination, errors: _Errors) -> Iterator[Finding]:
    """Yield scales, signs, exchanges, quarter turns and times, and rotations of the input."""
    for name in case.judged:
        space = case.evidence.scenario.sensors[name].sensor.output
        for group in groups(space):
            yield from _scale(case, errors, name, group)
        if space.size in (2, 3) and len(set(space.units)) == 1:
            for order in [*permutations(range(space.size))][1:]:  # the first one is as it is
                yield axes_exchanged(case, name, order, 0.0)
        yield from _quarter_turns(case, name)
        yield from _time(case, name)
    until = float(case.passage.first(_BEGINNING).series('time')[-1])
    yield from input_axes.by_passes(case, until, misfit)


def _quarter_turns(case: Examination, name: str) -> Iterator[Finding]:
    sensor = case.evidence.scenario.sensors[name].sensor
    # ranges of several landmarks are no axes
    for group in () if isinstance(sensor, Landmarks) else vectors(sensor.output):
        size = len(group)
        for turn in _QUARTERS if size == 3 else _QUARTERS[:3]:
            yield turned(case, name, group, turn[:size, :size], 0.0, '')


def _time(case: Examination, name: str) -> Iterator[Finding]:
    """Yield the likeliest time by which the stamps of a sensor are wrong, if any explains more."""
    search = TimeSearch(case, partial(shift_stamps, case.evidence, name), gain)
    start = max(_TIMES, key=search.gain)
    if search.gain(start) > 0.0:
        yield stamped(case.evidence, name, 0.0, search.from_time(start))


def _scale(
    case: Examination, errors: _Errors, name: str, group: tuple[int, ...]
) -> Iterator[Finding]:
    """Yield the likeliest factor of coordinates of a sensor, if any explains more."""
    count = errors.count(name) * len(group)

    @cache
    def gained(factor: float) -> float:
        M = scaling(case, name, group, factor)
        return errors.gain(mixed(case.evidence, name, M)) + 2.0 * count * log(abs(factor))

    start = max(_FACTORS, key=gained)
    if gained(start) <= 0.0:
        return
    sign = 1.0 if start > 0.0 else -1.0

    def along(logarithm: float) -> float:
        return gained(sign * exp(logarithm))

    middle, ratio = log(abs(start)), log(_RATIO)
    near = peak(along, middle - ratio, middle, middle + ratio)
    factor, std = sign * exp(near[1]), deviation(along, *near)
    if std < _KNOWN:
        yield scaled(case, (name,), group, factor, abs(factor) * std, 0.0)
