# SPDX-License-Identifier: Apache-2.0
"""The Rauch-Tung-Striebel smoother: estimates given all readings, including later ones.

Backwards over the beliefs x, P of a filter and their predictions x_p, P_p,

    C = P F' P_p^-1,   x_s = x + C (x_s' - x_p),
    P_s = C P_s' C' + R,   R = (I - C F) P (I - C F)' + C Q C'

(H. Rauch, F. Tung and C. Striebel, Maximum Likelihood Estimates of Linear Dynamic Systems, AIAA
Journal 3(8), 1965), with the covariance as a sum of positive semi-definite terms. F and Q are
the results of `SmoothableFilter.linearized`. With d = x_s - x, the change of a mean by later
readings, a step is affine,

    d = C d' + c,   c = C (x' - x_p).

Of a state with rotations these are differences in the tangent space at x, and d' is one at x',
where C takes those from x_p: to first order d = C J^-1 d' + c, with J^-1 the inverse left Jacobian
of x' - x_p.
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
        raise ValueError(f'filter: {unsmoothable()}')
    space: Space = filter.model.state
    later: Filtered | None = None
    change: Change | None = None
    for step in steps:
        if later is None or later.restarted or change is None:
            smoothed = step.belief
            known = not isinstance(smoothed, Diffuse)
            change = Change(np.zeros(space.size), smoothed.covariance) if known else None
        else:
            change = step_back(filter, step, later).of(change)
            smoothed = change.applied(space, step.belief.mean)
        later = step
        yield smoothed


def unsmoothable() -> str:
    """Return the reason why the beliefs of other filters cannot be smoothed."""
    names = [name for name in FILTERS if issubclass(filter_class(name), SmoothableFilter)]
    return f'expected one of ({", ".join(names)}), whose beliefs can be smoothed'


class Change(NamedTuple):
    """The change d of a filter's mean by later readings, and the covariance of the state then."""

    d: Array
    covariance: Array

    def applied(self, space: Space, x: Array) -> Gaussian:
        """Return the smoothed belief of a filter whose mean is ``x``."""
        return Gaussian(*space.arrived(x + self.d, x, self.covariance))


class StepBack(NamedTuple):
    """A step of the smoother, to the change of a state from that of a later one."""

    C: Array
    c: Array
    R: Array

    def of(self, later: Change) -> Change:
        """Return the change of the state, given that of the later one."""
        d, P = later
        return Change(self.C @ d + self.c, symmetric(self.C @ P @ self.C.T + self.R))

    def after(self, later: StepBack) -> StepBack:
        """Return the step from further ahead: first ``later``, then this one."""
        C = self.C
        return StepBack(C @ later.C, self.c + C @ later.c, k.sandwich(C, later.R, self.R))


def step_back(filter: SmoothableFilter, step: Filtered, later: Filtered) -> StepBack:
    """Return the step of the smoother to ``step`` from the next one.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the prediction has no positive definite covariance.
    """
    belief = step.belief
    predicted, F, Q = filter.linearized(belief, step.input, (later.time - step.time) * 1e-9)
    if isinstance(belief, Diffuse) and isinstance(predicted, Diffuse):
        P, C = belief.known, _gain_in_the_limit(F, belief, predicted)
    else:
        P = belief.covariance
        C = _gain(F @ P, predicted.covariance)
    I_CF = identity(len(P)) - C @ F
    R = k.sandwich(I_CF, P, k.sandwich(C, Q, np.zeros_like(P)))
    space: Space = filter.model.state
    change = space.subtract(later.belief.mean, predicted.mean)
    c = C @ change
    return StepBack(C @ space.slope_from_afar(change) if space.rotations else C, c, symmetric(R))


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
