# SPDX-License-Identifier: Apache-2.0
"""Maximisation of a likelihood by the method of scoring, from several starts.

Fisher's scoring takes the steps I^-1 g of the gradient g and the information I, damped as by
Levenberg and Marquardt, I + d diag(I): K. Lange, Optimization (2013), sections 10.4 and 15.7.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from kalman_ros.core import Array

from .likelihood import Expansion, Likelihood
from .scan import scanned

#: The fit ends if the predicted gain of log-likelihood is smaller. For a long recording, whose
#: passes take longer, the limit corresponds to a twentieth of a standard deviation.
_NEGLIGIBLE, _NEGLIGIBLE_LONG = 1e-9, 1e-3
_MOST_STEPS = 40
#: Initial damping, factor by which it changes, and its least and largest values.
_DAMPING, _FACTOR, _LEAST, _LARGEST = 1e-3, 10.0, 1e-6, 1e7
#: Parameters with less information are not moved, since the data do not depend on them.
_BLIND = 1e-6
#: Longest step on a logarithmic scale (a factor of 7), and in units of any other scale.
_LONGEST, _FAR = 2.0, 20.0
#: Number of other starts for each parameter that are compared, number that are followed, and
#: their spread.
_SCREENED, _FOLLOWED, _SPREAD = 24, 2, 1.5
#: Starts are compared on the first N readings, and followed until the predicted gain is small.
SHORT, LITTLE = 500, 0.03
#: Delays are scanned on the first N readings, or more of them where these are alike.
_SCANNED = 4 * SHORT
#: Predicted gain below which no further step is taken on all readings: half a standard deviation,
#: of which a step of scoring leaves some hundredths.
_NEARLY = 0.1
#: Predicted gain, that of a fifth of a standard deviation, below which an ascent is at its maximum
#: if no step is better. Rounding hides less, and so do the derivatives along delays: they are of
#: filters that correct a later state, where a nonlinear model is linearised elsewhere.
_UNRESOLVED = 0.02
#: An ascent within this distance of a known maximum, in standard deviations, ends there.
_NEAR = 5.0

#: Number of ascents from a plateau, and of values of a parameter that are compared there.
_PLATEAUS, _PLACES = 4, 12

#: Reason of an ascent that the user interrupted.
INTERRUPTED = 'interrupted'
#: Receives the current activity and the share of it that is done.
Report = Callable[[str, float], None]


def _ignore(activity: str, share: float) -> None:
    """Ignore the progress."""


@dataclass(frozen=True)
class Ascent:
    """The result of an ascent.

    Parameters
    ----------
    likelihood
        Likelihood that was maximised: of all readings, or of the first part if the ascent ended
        there.
    top
        Expansion with the highest value.
    steps
        Number of steps.
    stopped
        Reason for which the ascent ended before the maximum; '' if it reached the maximum.
    before
        Value at the start; -inf without a likelihood.
    """

    likelihood: Likelihood
    top: Expansion
    steps: int
    stopped: str = ''
    before: float = -np.inf


#: An ascent in progress: it requests the expansion at a point, with a message for the report.
Climb = Generator[tuple[Array, str], Expansion | None, Ascent]


def _ascend(
    likelihood: Likelihood, start: Expansion, negligible: float, ends: Sequence[Ascent]
) -> Climb:
    """Ascend from an expansion until the predicted gain is ``negligible``.

    The ascent also ends if it is near a maximum at which another ascent has ended.
    """
    current, damping, number = start, _DAMPING, 0
    path = [start]
    try:
        for number in range(_MOST_STEPS):
            tops = (end.top for end in ends if not end.stopped)
            known_top = next((top for top in tops if _is_near(current, top)), None)
            if known_top is not None:
                return Ascent(likelihood, known_top, number)
            J = _corrected_information(path)
            if scoring_step(likelihood, current, J, _LEAST)[1] < negligible:
                return Ascent(likelihood, current, number)
            step, gain = scoring_step(likelihood, current, J, damping)
            progress = f'step {number + 1}, log-likelihood {current.value:.6g}'
            candidate = yield current.z + step, progress
            if candidate is not None and candidate.value > current.value:
                damping = max(damping / _FACTOR, _LEAST)
                current = candidate
                path.append(current)
                continue
            shorter = _shorter_step(likelihood, current, damping)
            if shorter is None:
                at_top = gain < _UNRESOLVED
                return Ascent(likelihood, current, number, '' if at_top else 'no step is better')
            z, damping = shorter
            candidate = yield z, progress
            if candidate is None:
                return Ascent(likelihood, current, number, 'the best step has no derivatives')
            if (
                candidate.value > current.value
            ):  # `values` is approximate for long changes of a delay
                current = candidate
                path.append(current)
    except KeyboardInterrupt:
        return Ascent(likelihood, current, number, INTERRUPTED)
    return Ascent(
        likelihood, current, _MOST_STEPS, f'{_MOST_STEPS} steps from a start are not enough'
    )


def climb(
    likelihood: Likelihood,
    starts: Sequence[Expansion],
    report: Report = _ignore,
    negligible: float = _NEGLIGIBLE_LONG,
) -> list[Ascent]:
    """Ascend from several expansions, and return the ascents in the order in which they end.

    All ascents take their steps together, so that one pass through the recording serves them all.
    """
    ends: list[Ascent] = []
    climbs = [_ascend(likelihood, start, negligible, ends) for start in starts]
    expansions: Sequence[Expansion | None] = [None] * len(climbs)
    interrupted = False
    while climbs:
        active, requests = [], []
        for ascent, expansion in zip(climbs, expansions):
            try:
                requests.append(
                    ascent.throw(KeyboardInterrupt) if interrupted else ascent.send(expansion)
                )
                active.append(ascent)
            except StopIteration as end:
                ends.append(end.value)
                interrupted |= ends[-1].stopped == INTERRUPTED
        climbs = active
        if climbs and not interrupted:
            points, messages = zip(*requests)
            try:
                expansions = likelihood.expand_all(points, partial(report, messages[0]))
            except KeyboardInterrupt:
                interrupted = True
    return ends


def _is_near(current: Expansion, top: Expansion) -> bool:
    """Return whether a point is near a maximum, by the information at the maximum."""
    offset = current.z - top.z
    return current.value <= top.value and float(offset @ top.information @ offset) <= _NEAR**2


def scoring_step(
    likelihood: Likelihood, current: Expansion, J: Array, damping: float
) -> tuple[Array, float]:
    """Return a damped step within the limits, and its predicted gain to first order."""
    g, z = current.gradient, current.z
    limits = np.array([free.limits for free in likelihood.parameters]).reshape(-1, 2)
    blocked = ((z <= limits[:, 0]) & (g < 0.0)) | ((z >= limits[:, 1]) & (g > 0.0))
    diagonal = J.diagonal()
    free = ~blocked & (diagonal > _BLIND)
    step = np.zeros(len(z))
    if not free.any():
        return step, 0.0
    d = np.sqrt(diagonal[free])
    C = J[np.ix_(free, free)] / np.outer(d, d)
    solved = np.linalg.lstsq(C + damping * np.eye(len(C)), g[free] / d, rcond=None)[0]
    step[free] = solved / d
    longest = np.array([_LONGEST if free.positive else _FAR for free in likelihood.parameters])
    step /= max(1.0, float(np.max(np.abs(step) / longest)))
    step = np.clip(z + step, limits[:, 0], limits[:, 1]) - z
    return step, 0.5 * float(g @ step)


def _corrected_information(path: Sequence[Expansion]) -> Array:
    """Return the information (p, p) at the end of a path, corrected by changes of the gradient.

    The expected information differs from the curvature. Each of the last steps corrects it by the
    formula of Broyden, Fletcher, Goldfarb and Shanno (J. Nocedal and S. Wright, Numerical
    Optimization, 2006, section 6.1).
    """
    J = path[-1].information
    for before, after in list(pairwise(path))[-len(J) :]:
        s, y = after.z - before.z, before.gradient - after.gradient
        Js = J @ s
        if s @ y > 0.1 * (s @ Js) > 0.0:
            J = J - np.outer(Js, Js) / (s @ Js) + np.outer(y, y) / (s @ y)
    return J


def _shorter_step(
    likelihood: Likelihood, current: Expansion, damping: float
) -> tuple[Array, float] | None:
    """Return the end of the best shorter step and its damping; None if no step is better."""
    dampings = [damping * _FACTOR**k for k in range(1, 20) if damping * _FACTOR**k < _LARGEST]
    J = current.information
    points = [current.z + scoring_step(likelihood, current, J, trial)[0] for trial in dampings]
    if not points:
        return None
    values = likelihood.values(points)
    best = int(np.argmax(values))
    return (points[best], dampings[best]) if values[best] > current.value else None


def maximum(likelihood: Likelihood, report: Report = _ignore, seed: int = 0) -> Ascent:
    """Return the highest maximum that is reached from the start and from other starts about it.

    The starts are compared on the first part of a long recording and followed there. Its maximum
    is so close to that of all readings that one more step usually suffices. If the ascent is
    interrupted, or if all readings together have no likelihood, the result of the first part is
    returned.

    Raises
    ------
    ValueError
        If no start has a likelihood.
    KeyboardInterrupt
        If it is interrupted before there is a result.
    """
    short = likelihood.first(SHORT)
    is_whole = short is likelihood
    centres = [likelihood.start]
    best = scanned(likelihood, _SCANNED, report)
    if (best != centres[0]).any():
        centres.append(best)
    report('comparing starts', 0.0)
    families = [_starts(likelihood, centre, seed) for centre in centres]
    values = np.concatenate([short.values(family) for family in families])
    points = [point for family in families for point in family]
    if not np.isfinite(values).any():
        raise ValueError(
            'no likelihood at the start, nor at any other: the estimate is not finite, or no '
            'reading can be explained; check the parameters with ./dev doctor'
        )
    order = np.argsort(-values, kind='stable')
    followed = [points[i] for i in order[:_FOLLOWED].tolist() if np.isfinite(values[i])]
    expanded = [start for start in short.expand_all(followed) if start is not None]
    before = float(values[0])
    ends = climb(short, expanded, report, LITTLE)
    if any(end.stopped == INTERRUPTED for end in ends):
        return _highest(ends, before, INTERRUPTED)
    try:
        if not ends:
            raise ValueError('no likelihood near any start: it cannot be differentiated')
        if is_whole:
            highest = _highest(ends, before)
            polished = _climbed(likelihood, highest.top, report, _NEGLIGIBLE)
            return replace(polished, before=before, steps=highest.steps + polished.steps)
        tops = {id(end.top): end.top.z for end in ends}.values()
        expansions = likelihood.expand_all([*centres, *tops], partial(report, 'all readings'))
    except KeyboardInterrupt:
        return _highest(ends, before, INTERRUPTED)
    expanded = [start for start in expansions if start is not None]
    if not expanded:
        return _highest(ends, before, 'all readings together have no likelihood')
    before = -np.inf if expansions[0] is None else expansions[0].value
    highest_start = max(expanded, key=lambda start: start.value)
    return replace(_climbed(likelihood, highest_start, report, _NEARLY), before=before)


def _climbed(
    likelihood: Likelihood, start: Expansion, report: Report, negligible: float
) -> Ascent:
    """Return the ascent from an expansion, and over the plateaus that it ends on.

    Where a noise is so small that the data no longer show it, the likelihood is level, and may be
    higher elsewhere.
    """
    steps = 0
    for _ in range(_PLATEAUS):
        end = climb(likelihood, [start], report, negligible)[0]
        steps += end.steps
        higher = None if end.stopped else _beyond_plateau(likelihood, end.top)
        if higher is None:
            break
        start = higher
    return replace(end, steps=steps)


def _beyond_plateau(likelihood: Likelihood, top: Expansion) -> Expansion | None:
    """Return a point that is likelier, by another value of a parameter that does not show."""
    best, most = None, top.value + LITTLE
    for index in np.flatnonzero(top.information.diagonal() <= _BLIND).tolist():
        points, values = towards_start(likelihood, top.z, index)
        highest = int(np.argmax(values))
        if values[highest] > most:
            best, most = points[highest], values[highest]
    return None if best is None else likelihood.expand(best)


def towards_start(likelihood: Likelihood, z: Array, index: int) -> tuple[Array, Array]:
    """Return points from the start of one parameter to its value at z (p,), and their likelihood.

    The points (`_PLACES`, p) do not contain z.
    """
    points = np.tile(z, (_PLACES, 1))
    points[:, index] = np.linspace(likelihood.start[index], z[index], _PLACES, endpoint=False)
    return points, likelihood.values(list(points))


def _highest(ends: Sequence[Ascent], before: float, stopped: str = '') -> Ascent:
    """Return the highest of several ascents; ``stopped`` is the reason if all ended early."""
    best = max(ends, key=lambda end: end.top.value)
    return replace(best, before=before, stopped=stopped or best.stopped)


def _starts(likelihood: Likelihood, start: Array, seed: int) -> list[Array]:
    """Return a start and random points about it."""
    rng = np.random.default_rng(seed)
    limits = np.array([free.limits for free in likelihood.parameters]).reshape(-1, 2)
    low, high = limits[:, 0], np.maximum(limits[:, 0], limits[:, 1])
    spread = np.array([_SPREAD if free.positive else 1.0 for free in likelihood.parameters])
    points = [start]
    for _ in range(_SCREENED * len(start)):
        points.append(np.clip(start + spread * rng.standard_normal(len(start)), low, high))
    return points
