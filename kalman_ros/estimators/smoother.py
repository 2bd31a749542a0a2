# SPDX-License-Identifier: Apache-2.0
"""The Rauch-Tung-Striebel smoother: estimates given all readings, later ones included.

Backwards over the beliefs x, P of a filter and their predictions x_p, P_p,

    C = P F' P_p^-1,   x_s = x + C (x_s' - x_p),
    P_s = (I - C F) P (I - C F)' + C (P_s' + Q) C'

(H. Rauch, F. Tung and C. Striebel, Maximum Likelihood Estimates of Linear Dynamic Systems, AIAA
Journal 3(8), 1965), with the covariance as a sum of positive semi-definite terms. F belongs to the
model about the estimate; for the unscented filter it is the slope of the sigma points (S.
Sarkka, Unscented Rauch-Tung-Striebel Smoother, IEEE Trans. Automatic Control 53(3), 2008).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Gaussian, Model, solve, symmetric
from kalman_ros.linear.factor import cholesky

from .ekf import ExtendedKalmanFilter
from .kf import KalmanFilter
from .ukf import UnscentedKalmanFilter

#: Filters whose beliefs can be smoothed, as their gains are optimal.
SMOOTHED = ('kf', 'ekf', 'ukf')


@dataclass(frozen=True)
class Filtered:
    """The filter's result at one instant.

    Parameters
    ----------
    time
        In nanoseconds.
    belief
        After all readings of this instant and before it.
    input
        In effect from then on (m,).
    restarted
        Whether the belief is independent of the one before.
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
        The filter of the steps: a Kalman filter, plain, extended or unscented.
    steps
        In order of time, without repeated times. Steps may have any length.

    Raises
    ------
    ValueError
        If the filter is of another kind, whose gains are not optimal.
    numpy.linalg.LinAlgError
        If a prediction has no positive definite covariance.
    """
    return [*smoothed_back(filter, reversed(steps))][::-1]


def smoothed_back(filter: object, steps: Iterable[Filtered]) -> Iterator[Gaussian]:
    """Yield the beliefs of `smooth`, the last first, of ``steps`` in reverse order.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError
        As `smooth` does.
    """
    if not isinstance(filter, (KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter)):
        raise ValueError(
            f'filter: expected the beliefs of one of ({", ".join(SMOOTHED)}), '
            f'got those of a {type(filter).__name__}'
        )
    later: Filtered | None = None
    smoothed: Gaussian | None = None
    for step in steps:
        if later is None or smoothed is None or later.restarted:
            smoothed = step.belief
        else:
            smoothed = _back(filter, step, later.time, smoothed)
        later = step
        yield smoothed


def _back(
    filter: KalmanFilter | ExtendedKalmanFilter | UnscentedKalmanFilter,
    step: Filtered,
    until: int,
    after: Gaussian,
) -> Gaussian:
    """Return the smoothed belief of a step, from the one ``after`` it, at time ``until``."""
    model: Model = filter.model
    belief, u, dt = step.belief, step.input, (until - step.time) * 1e-9
    x, P = belief.mean, belief.covariance
    predicted = filter.predict(belief, u, dt)
    if isinstance(filter, UnscentedKalmanFilter):
        F = _slope(P, filter.cross_covariance(belief, u, dt))
        Q = symmetric(predicted.covariance - F @ P @ F.T)
    else:
        transition = model.transition(x, u, dt)
        F, Q = transition.F, transition.Q
    _, P_p, _ = cholesky(predicted.covariance)
    C = solve(P_p, F @ P).T
    change = model.state.subtract(after.mean, predicted.mean)
    P_s = model.state.from_afar(after.covariance, change)
    I_CF = np.eye(x.size) - C @ F
    covariance = symmetric(I_CF @ P @ I_CF.T + C @ (P_s + Q) @ C.T)
    return Gaussian(*model.state.arrived(x + C @ change, x, covariance))


def _slope(P: Array, cross: Array) -> Array:
    """Return F (n, n) with F P = cross'; the smallest, if states are known exactly."""
    try:
        return np.asarray(solve(P, cross).T)
    except np.linalg.LinAlgError:
        variances = P.diagonal()
        # the units of the states do not matter
        std = np.sqrt(np.where(variances > 0.0, variances, 1.0))
        scaled = np.linalg.lstsq(P / np.outer(std, std), cross / std[:, np.newaxis], rcond=None)[0]
        return np.asarray((scaled / std[:, np.newaxis]).T)
