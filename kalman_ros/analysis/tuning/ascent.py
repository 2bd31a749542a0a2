# SPDX-License-Identifier: Apache-2.0
"""The maximum of a likelihood, by the method of scoring, from several starts.

Fisher's scoring takes the steps I^-1 g of the gradient g and the information I, damped as by
Levenberg and Marquardt, I + d diag(I): K. Lange, Optimization (2013), sections 10.4 and 15.7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kalman_ros.core import Array

from .likelihood import Expansion, Likelihood

#: The fit ends if a step promises to raise the log-likelihood by less.
_NEGLIGIBLE = 1e-7
_MOST_STEPS = 40
#: The first damping, by how much it changes, and the largest.
_DAMPING, _FACTOR, _LARGEST = 1e-3, 10.0, 1e7
#: The longest step on a logarithmic scale, a factor of 7, and in units of other scales.
_LONGEST, _FAR = 2.0, 20.0
#: Other starts: how many are compared, how many of them are followed, and how far they are.
_SCREENED, _FOLLOWED, _SPREAD = 24, 2, 1.5
#: Starts are compared on the first N readings.
SHORT = 1500

#: Called with what is done and which share of it.
Report = Callable[[str, float], None]


def _ignore(what: str, share: float) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Ascent:
    """Where an ascent ended.

    Parameters
    ----------
    top
        The expansion there.
    converged
        Whether no step promised anything more.
    steps
        The number of steps.
    """

    top: Expansion
    converged: bool
    steps: int


def climb(
    likelihood: Likelihood, start: Expansion, report: Report = _ignore, most: int = _MOST_STEPS
) -> Ascent:
    """Return the maximum that is reached from an expansion."""
    here, damping = start, _DAMPING
    limits = np.array([each.limits for each in likelihood.parameters]).reshape(-1, 2)
    for number in range(most):
        step, gain = _step(likelihood, here, damping, limits)
        if gain < _NEGLIGIBLE:
            return Ascent(here, True, number)
        what = f'step {number + 1}, log-likelihood {here.value:.6g}'
        there = likelihood.expand(here.z + step, partial(report, what))
        if there is not None and there.value > here.value:
            damping = max(damping / _FACTOR, 1e-9)
            here = there
            continue
        found = _shorter(likelihood, here, damping, limits)
        if found is None:
            # no step raises a value that rounding hides
            return Ascent(here, gain < 1e-3, number)
        z, damping = found
        there = likelihood.expand(z)
        if there is None:
            return Ascent(here, False, number)
        here = there
    return Ascent(here, False, most)


def _step(
    likelihood: Likelihood, here: Expansion, damping: float, limits: Array
) -> tuple[Array, float]:
    """Return a damped step within the limits, and what it promises to first order."""
    g, J, z = here.gradient, here.information, here.z
    stuck = ((z <= limits[:, 0]) & (g < 0.0)) | ((z >= limits[:, 1]) & (g > 0.0))
    size = J.diagonal()
    free = ~stuck & (size > 1e-12 * max(float(size.max(initial=0.0)), 1e-12))
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


def _shorter(
    likelihood: Likelihood, here: Expansion, damping: float, limits: Array
) -> tuple[Array, float] | None:
    """Return the best of several shorter steps, with its damping; None if none is better."""
    dampings = [damping * _FACTOR**k for k in range(1, 20) if damping * _FACTOR**k < _LARGEST]
    points = [here.z + _step(likelihood, here, each, limits)[0] for each in dampings]
    if not points:
        return None
    values = likelihood.values(points)
    best = int(np.argmax(values))
    return (points[best], dampings[best]) if values[best] > here.value else None


def maximum(likelihood: Likelihood, report: Report = _ignore, seed: int = 0) -> Ascent:
    """Return the highest maximum from the start and from others about it.

    Long recordings are begun with their first part, where the other starts are compared.

    Raises
    ------
    ValueError
        If there is no likelihood at the start, nor at any other.
    """
    short = _shortened(likelihood)
    points = _starts(likelihood, seed)
    report('comparing starts', 0.0)
    values = short.values(points)
    if not np.isfinite(values).any():
        raise ValueError(
            'no likelihood at the start, nor at any other: the estimate is not finite, or no '
            'reading can be explained; check the parameters with ./dev doctor'
        )
    order = np.argsort(-values, kind='stable')
    chosen = list(dict.fromkeys([0, *order[:_FOLLOWED].tolist()]))
    ends = []
    for index in chosen:
        begin = short.expand(points[index]) if np.isfinite(values[index]) else None
        if begin is not None:
            ends.append(climb(short, begin, report))
    if not ends:
        raise ValueError('no likelihood near any start: it cannot be differentiated')
    if short is likelihood:
        return max(ends, key=lambda each: each.top.value)
    tops = [points[0], *(each.top.z for each in ends)]
    best = tops[int(np.argmax(likelihood.values(tops)))]
    begin = likelihood.expand(best, partial(report, 'all readings'))
    if begin is None:
        raise ValueError('no likelihood on all readings: the estimate is not finite')
    return climb(likelihood, begin, report)


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
