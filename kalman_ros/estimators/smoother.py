# SPDX-License-Identifier: Apache-2.0
"""The Rauch-Tung-Striebel smoother: estimates given all readings, including later ones.

Backwards over the beliefs x, P of a filter and their predictions x_p, P_p,

    C = P F' P_p^-1,   x_s = x + C (x_s' - x_p),
    P_s = C P_s' C' + R,   R = (I - C F) P (I - C F)' + C Q C'

(H. Rauch, F. Tung and C. Striebel, Maximum Likelihood Estimates of Linear Dynamic Systems, AIAA
Journal 3(8), 1965), with the covariance as a sum of positive semi-definite terms. F and Q are
the results of `SmoothableFilter.linearized`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Gaussian, Space, is_finite, solve, symmetric
from kalman_ros.linear import single as k
from kalman_ros.linear.factor import cholesky
from kalman_ros.linear.matrices import identity

from . import FILTERS, filter_class
from .diffuse import Diffuse
from .filter import SmoothableFilter

#: Ratio of a variance that stands for an infinite one to the others. The error of the limit that
#: it gives is about its inverse squared.
_LARGE = 1e5


@dataclass(frozen=True)
class Filtered:
    """The result of a filter at one instant.

    Parameters
    ----------
    time
        Time of the instant, in nanoseconds.
    belief
        Belief after all readings up to this instant.
    input
        Input (m,) in effect from this instant on.
    restarted
        Whether the belief is independent of the previous one.
    """

    time: int
    belief: Gaussian
    input: Array
    restarted: bool = False


def smooth(filter: object, steps: Sequence[Filtered]) -> list[Gaussian]:
    """Return the belief at each step given all readings.

    Parameters
    ----------
    filter
        Filter of the steps, a `SmoothableFilter`.
    steps
        Results in order of time, without repeated times. Intervals may have any length.

    Raises
    ------
    ValueError
        If the filter is of another kind.
    numpy.linalg.LinAlgError
        If a prediction has no positive definite covariance.
    """
    return [*smoothed_back(filter, reversed(steps))][::-1]


def smoothed_back(filter: object, steps: Iterable[Filtered]) -> Iterator[Gaussian]:
    """Yield the beliefs of `smooth` from the last to the first, for ``steps`` in reverse order.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError
        In the same cases as `smooth`.
    """
    if not isinstance(filter, SmoothableFilter):
        raise ValueError(f'filter: {unsmoothable(filter)}')
    later: Filtered | None = None
    smoothed: Gaussian | None = None
    for step in steps:
        alone = later is None or later.restarted or isinstance(smoothed, Diffuse)
        if alone or later is None or smoothed is None:
            smoothed = step.belief
        else:
            back = step_back(filter, step, later.time)
            smoothed = carried_back(filter.model.state, step.belief, back, smoothed)
        later = step
        yield smoothed


def unsmoothable(filter: object) -> str:
    """Return the reason why the beliefs of a filter cannot be smoothed."""
    names = [name for name in FILTERS if issubclass(filter_class(name), SmoothableFilter)]
    expected = f'expected the beliefs of one of ({", ".join(names)})'
    return f'{expected}, got those of a {type(filter).__name__}'


class StepBack(NamedTuple):
    """A step of the smoother: P_s = C P_s' C' + R, and x_s = x + C (x_s' - ``predicted``)."""

    predicted: Array
    C: Array
    R: Array


def step_back(filter: SmoothableFilter, step: Filtered, until: int) -> StepBack:
    """Return the step of the smoother to ``step`` from the next one, at time ``until``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the prediction has no positive definite covariance.
    """
    belief = step.belief
    predicted, F, Q = filter.linearized(belief, step.input, (until - step.time) * 1e-9)
    if isinstance(belief, Diffuse) and isinstance(predicted, Diffuse):
        P, C = belief.known, _gain_in_the_limit(F, belief, predicted)
    else:
        P = belief.covariance
        C = _gain(F @ P, predicted.covariance)
    I_CF = identity(len(P)) - C @ F
    R = k.sandwich(I_CF, P, k.sandwich(C, Q, np.zeros_like(P)))
    return StepBack(predicted.mean, C, symmetric(R))


def _gain_in_the_limit(F: Array, before: Diffuse, after: Diffuse) -> Array:
    """Return the limit of C for infinite variances, by extrapolation from two finite ones."""
    c = _LARGE * (float(np.abs(after.known).max()) or 1.0) / float(np.abs(after.unknown).max())
    near, far = (_gain(F @ before.at(s).covariance, after.at(s).covariance) for s in (c, 2 * c))
    return 2.0 * far - near


def _gain(FP: Array, P_p: Array) -> Array:
    """Return C = P F' P_p^-1, where P_p may have to be repaired or be singular."""
    try:
        C = k.divided(FP, P_p)
        if is_finite(C):
            return C
    except np.linalg.LinAlgError:
        pass
    _, P_p, _ = cholesky(P_p)
    try:
        solved = solve(P_p, FP)
    except np.linalg.LinAlgError:  # some states are known exactly
        solved = _solve_singular(P_p, FP)
    return np.asarray(solved.T)


def _solve_singular(P: Array, right: Array) -> Array:
    """Return P^+ ``right`` of a covariance with zeros, by its correlations."""
    std = np.sqrt(P.diagonal())
    std[std == 0.0] = 1.0
    inverse = np.linalg.pinv(P / np.outer(std, std), hermitian=True)
    return np.asarray((inverse @ (right / std[:, None])) / std[:, None])


def carried_back(space: Space, belief: Gaussian, back: StepBack, after: Gaussian) -> Gaussian:
    """Return the smoothed ``belief`` of a step, given that of the step ``after`` it."""
    x, (predicted, C, R) = belief.mean, back
    change = space.subtract(after.mean, predicted)
    P_s = space.from_afar(after.covariance, change)
    return Gaussian(*space.arrived(x + C @ change, x, symmetric(C @ P_s @ C.T + R)))
