# SPDX-License-Identifier: Apache-2.0
"""The maximum of a likelihood, by the method of scoring, from several starts.

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

#: The fit ends if a step promises to raise the log-likelihood by less; of a long recording, whose
#: passes take longer, by a twentieth of a standard deviation.
_NEGLIGIBLE, _NEGLIGIBLE_LONG = 1e-9, 1e-3
_MOST_STEPS = 40
#: The first damping, by how much it changes, the least and the largest.
_DAMPING, _FACTOR, _LEAST, _LARGEST = 1e-3, 10.0, 1e-6, 1e7
#: Parameters with less information stay where they are: the data do not depend on them.
_BLIND = 1e-6
#: The longest step on a logarithmic scale, a factor of 7, and in units of other scales.
_LONGEST, _FAR = 2.0, 20.0
#: Other starts: how many are compared, how many of them are followed, and how far they are.
_SCREENED, _FOLLOWED, _SPREAD = 24, 2, 1.5
#: Starts are compared on the first N readings, and followed there until little is left to gain.
SHORT, LITTLE = 500, 0.03
#: A last step of scoring follows where it promises at most this: half a standard deviation, of
#: which it leaves some hundredths.
_NEARLY = 0.1
#: An ascent that comes within this distance of a maximum, in standard deviations, leads there.
_NEAR = 5.0

#: Why an ascent stopped that somebody stopped.
INTERRUPTED = 'interrupted'
#: Called with what is done and which share of it.
Report = Callable[[str, float], None]


def _ignore(what: str, share: float) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Ascent:
    """Where an ascent ended.

    Parameters
    ----------
    likelihood
        What was climbed: that of all readings, or of the first ones if it came no further.
    top
        The best expansion.
    steps
        The number of steps.
    stopped
        Why it ended before the maximum; '' if no step promised anything more.
    before
        The value at the start, -inf if it has none.
    """

    likelihood: Likelihood
    top: Expansion
    steps: int
    stopped: str = ''
    before: float = -np.inf


#: An ascent under way: it asks for the expansion at a point, with a line for the report.
Climb = Generator[tuple[Array, str], Expansion | None, Ascent]


def _climb(
    likelihood: Likelihood, start: Expansion, negligible: float, ends: Sequence[Ascent]
) -> Climb:
    """Follow an expansion to where it leads, up to a gain that is ``negligible``.

    It ends at one of the maxima where other ascents have ended, as soon as it is near.
    """
    here, damping, number = start, _DAMPING, 0
    path = [start]
    try:
        for number in range(_MOST_STEPS):
            tops = (each.top for each in ends if not each.stopped)
            reached = next((top for top in tops if _near(here, top)), None)
            if reached is not None:
                return Ascent(likelihood, reached, number)
            J = _curvature(path)
            if _step(likelihood, here, J, _LEAST)[1] < negligible:
                return Ascent(likelihood, here, number)
            step, gain = _step(likelihood, here, J, damping)
            what = f'step {number + 1}, log-likelihood {here.value:.6g}'
            there = yield here.z + step, what
            if there is not None and there.value > here.value:
                damping = max(damping / _FACTOR, _LEAST)
                here = there
                path.append(here)
                continue
            found = _shorter(likelihood, here, damping)
            if found is None:
                # no step raises a value that rounding hides
                return Ascent(likelihood, here, number, '' if gain < 1e-3 else 'no step is better')
            z, damping = found
            there = yield z, what
            if there is None:
                return Ascent(likelihood, here, number, 'the best step has no derivatives')
            if there.value > here.value:  # longer changes of delays are compared approximately
                here = there
                path.append(here)
    except KeyboardInterrupt:
        return Ascent(likelihood, here, number, INTERRUPTED)
    return Ascent(likelihood, here, _MOST_STEPS, f'{_MOST_STEPS} steps are not enough')


def climb(
    likelihood: Likelihood,
    starts: Sequence[Expansion],
    report: Report = _ignore,
    negligible: float = _NEGLIGIBLE_LONG,
) -> list[Ascent]:
    """Return where several expansions lead, in the order in which they get there.

    They climb in step, so that one pass through the recording serves them all.
    """
    ends: list[Ascent] = []
    climbs = [_climb(likelihood, start, negligible, ends) for start in starts]
    found: Sequence[Expansion | None] = [None] * len(climbs)
    interrupted = False
    while climbs:
        under_way, wishes = [], []
        for each, there in zip(climbs, found):
            try:
                wishes.append(each.throw(KeyboardInterrupt) if interrupted else each.send(there))
                under_way.append(each)
            except StopIteration as end:
                ends.append(end.value)
                interrupted |= ends[-1].stopped == INTERRUPTED
        climbs = under_way
        if climbs and not interrupted:
            points, lines = zip(*wishes)
            try:
                found = likelihood.expand_all(points, partial(report, lines[0]))
            except KeyboardInterrupt:
                interrupted = True
    return ends


def _near(here: Expansion, top: Expansion) -> bool:
    """Return whether a point is on the slope of a maximum, by the maximum's information."""
    away = here.z - top.z
    return here.value <= top.value and float(away @ top.information @ away) <= _NEAR**2


def _step(
    likelihood: Likelihood, here: Expansion, J: Array, damping: float
) -> tuple[Array, float]:
    """Return a damped step within the limits, and what it promises to first order."""
    g, z = here.gradient, here.z
    limits = np.array([each.limits for each in likelihood.parameters]).reshape(-1, 2)
    stuck = ((z <= limits[:, 0]) & (g < 0.0)) | ((z >= limits[:, 1]) & (g > 0.0))
    size = J.diagonal()
    free = ~stuck & (size > _BLIND)
    step = np.zeros(len(z))
    if not free.any():
        return step, 0.0
    d = np.sqrt(size[free])
    C = J[np.ix_(free, free)] / np.outer(d, d)
    solved = np.linalg.lstsq(C + damping * np.eye(len(C)), g[free] / d, rcond=None)[0]
    step[free] = solved / d
    longest = np.array([_LONGEST if each.positive else _FAR for each in likelihood.parameters])
    step *= min(1.0, 1.0 / max(float(np.max(np.abs(step) / longest)), 1e-300))
    step = np.clip(z + step, limits[:, 0], limits[:, 1]) - z
    return step, 0.5 * float(g @ step)


def _curvature(path: Sequence[Expansion]) -> Array:
    """Return the information (p, p) at the end of a path, corrected by how the gradient changed.

    The expected information is not the curvature; the last steps show the difference. Each
    corrects it by the formula of Broyden, Fletcher, Goldfarb and Shanno (J. Nocedal and S. Wright,
    Numerical Optimization, 2006, section 6.1).
    """
    J = path[-1].information
    for before, after in list(pairwise(path))[-len(J) :]:
        s, y = after.z - before.z, before.gradient - after.gradient
        Js = J @ s
        if s @ y > 0.1 * (s @ Js) > 0.0:
            J = J - np.outer(Js, Js) / (s @ Js) + np.outer(y, y) / (s @ y)
    return J


def _shorter(
    likelihood: Likelihood, here: Expansion, damping: float
) -> tuple[Array, float] | None:
    """Return the best of several shorter steps, with its damping; None if none is better."""
    dampings = [damping * _FACTOR**k for k in range(1, 20) if damping * _FACTOR**k < _LARGEST]
    J = here.information
    points = [here.z + _step(likelihood, here, J, each)[0] for each in dampings]
    if not points:
        return None
    values = likelihood.values(points)
    best = int(np.argmax(values))
    return (points[best], dampings[best]) if values[best] > here.value else None


def maximum(likelihood: Likelihood, report: Report = _ignore, seed: int = 0) -> Ascent:
    """Return the highest maximum from the start and from others about it.

    Long recordings are begun with their first part, where the other starts are compared, and of
    the whole so little is left to gain that one more step is enough. If that is interrupted, or
    the whole has no likelihood, what was reached until then is returned.

    Raises
    ------
    ValueError
        If there is no likelihood at the start, nor at any other.
    KeyboardInterrupt
        If it is interrupted before anything was reached.
    """
    short = _shortened(likelihood)
    whole = short is likelihood
    points = _starts(likelihood, seed)
    report('comparing starts', 0.0)
    values = short.values(points)
    if not np.isfinite(values).any():
        raise ValueError(
            'no likelihood at the start, nor at any other: the estimate is not finite, or no '
            'reading can be explained; check the parameters with ./dev doctor'
        )
    order = np.argsort(-values, kind='stable')
    followed = [points[i] for i in order[:_FOLLOWED].tolist() if np.isfinite(values[i])]
    begins = [each for each in short.expand_all(followed) if each is not None]
    before = float(values[0])
    ends = climb(short, begins, report, LITTLE)
    if any(each.stopped == INTERRUPTED for each in ends):
        return _best(ends, before, INTERRUPTED)
    try:
        if not ends:
            raise ValueError('no likelihood near any start: it cannot be differentiated')
        if whole:
            highest = _best(ends, before)
            polished = climb(likelihood, [highest.top], report, _NEGLIGIBLE)[0]
            return replace(polished, before=before, steps=highest.steps + polished.steps)
        tops = {id(each.top): each.top.z for each in ends}.values()
        found = likelihood.expand_all([points[0], *tops], partial(report, 'all readings'))
    except KeyboardInterrupt:
        return _best(ends, before, INTERRUPTED)
    begins = [each for each in found if each is not None]
    if not begins:
        return _best(ends, before, 'all readings together have no likelihood')
    before = -np.inf if found[0] is None else found[0].value
    begin = max(begins, key=lambda each: each.value)
    return replace(climb(likelihood, [begin], report, _NEARLY)[0], before=before)


def _best(ends: Sequence[Ascent], before: float, stopped: str = '') -> Ascent:
    """Return the highest of several ascents; ``stopped`` says why they all ended early."""
    best = max(ends, key=lambda each: each.top.value)
    return replace(best, before=before, stopped=stopped or best.stopped)


def _shortened(likelihood: Likelihood) -> Likelihood:
    """Return the likelihood of the first part of a long recording; or the same of a short one."""
    stamps = np.sort(
        np.concatenate([each.stamp for each in likelihood.observations.readings.values()])
    )
    if likelihood.until is not None:
        stamps = stamps[stamps <= likelihood.until]
    if len(stamps) <= 2 * SHORT:
        return likelihood
    return replace(likelihood, until=int(stamps[SHORT]))


def _starts(likelihood: Likelihood, seed: int) -> list[Array]:
    """Return the start, and points about it."""
    rng = np.random.default_rng(seed)
    start = likelihood.start
    limits = np.array([each.limits for each in likelihood.parameters]).reshape(-1, 2)
    low, high = limits[:, 0], np.maximum(limits[:, 0], limits[:, 1])
    spread = np.array([_SPREAD if each.positive else 1.0 for each in likelihood.parameters])
    found = [start]
    for _ in range(_SCREENED):
        found.append(np.clip(start + spread * rng.standard_normal(len(start)), low, high))
    return found
