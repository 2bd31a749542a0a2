# SPDX-License-Identifier: Apache-2.0
"""A filter of the error of a pass, with errors of sensors that the pass does not know.

Numbers that sensors read join the state of the linearised pass, with the state's error about the
predictions of the pass: after each event the pass moves its estimate by K nu, and the error by as
much the other way. The likelihood is that of the innovations of this larger filter (F. Schweppe,
Evaluation of Likelihood Functions for Gaussian Signals, IEEE Trans. Information Theory 11(1),
1965). A path is drawn backwards from the filter's beliefs (S. Fruehwirth-Schnatter, Data
Augmentation and Dynamic Linear Models, J. Time Series Analysis 15(2), 1994): readings less the
mean path would scatter less than their noise, and less a drawn one they scatter as they should.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros.compiled.recursions import Errors, follow
from kalman_ros.core import Array
from kalman_ros.linear import single
from kalman_ros.linear.matrices import symmetric

from .passage import Passage

#: Seed of the drawn path: the same recording has the same diagnosis.
_SEED = 1
#: Share of a variance that is added, so that what is known exactly has an inverse.
_NUGGET = 1e-9


def errors_of(passage: Passage, loads: Mapping[str, Array]) -> Errors:
    """Return the readings of a pass, with the error of its state and of c further numbers.

    Parameters
    ----------
    passage
        Pass.
    loads
        What the readings of a sensor have of the further numbers (k, c) or (N, k, c), by sensor.
        Their step is missing.
    """
    E, n = passage.series('x').shape
    size = n + next(iter(loads.values())).shape[-1]
    F, Q = np.zeros((2, E, size, size))
    F[:, :n, :n], Q[:, :n, :n] = passage.series('F'), passage.series('Q')
    moved = np.zeros((E, size))
    moved[:, :n] = passage.corrections
    known = passage.rows
    H = np.zeros((len(known.H), size))
    H[:, :n] = known.H
    R, innovation = np.zeros(known.white.shape), np.zeros(len(H))
    for name in passage.names:
        at, k = passage.rows_of(name), passage.series('R', name).shape[-1]
        R[at, :k] = passage.series('R', name).reshape(-1, k)
        innovation[at] = passage.series('innovation', name).ravel()
    for name, load in loads.items():
        of_all = np.broadcast_to(load, (len(passage.of(name)), *load.shape[-2:]))
        H[passage.rows_of(name), n:] = of_all.reshape(-1, size - n)
    return Errors(F, Q, known.sizes, known.first, H, R, innovation, moved)


class ErrorFilter:
    """A filter of the error of the state of a pass and of c further numbers.

    Parameters
    ----------
    errors
        Readings of the pass, and the steps of the error.
    first, further
        Covariance of the state (n, n) and of the further numbers (c, c) at the first event.
    """

    def __init__(self, errors: Errors, first: Array, further: Array) -> None:
        n = self._n = len(first)
        self._errors, self._start = errors, np.zeros(errors.F.shape[1:])
        self._start[:n, :n], self._start[n:, n:] = first, further
        self.misfit = follow(self._errors, self._start)

    def path(self, events: Any) -> Array:
        """Return a path (E, c) of the further numbers at events, drawn given all readings."""
        rng, n, errors = np.random.default_rng(_SEED), self._n, self._errors
        means, covariances = beliefs = np.empty(errors.F.shape[:2]), np.empty(errors.F.shape)
        follow(errors, self._start, beliefs)
        drawn = _draw(rng, means[-1], covariances[-1])
        offsets = [drawn[n:]]
        for index in reversed(range(len(means) - 1)):
            (m, P), F, Q = (
                (means[index], covariances[index]),
                errors.F[index + 1],
                errors.Q[index + 1],
            )
            after = symmetric(F.dot(P).dot(F.T) + Q)
            back = _solved(after, F @ P).T
            # Joseph's form, in which nothing cancels
            left = np.eye(len(m)) - back @ F
            covariance = left @ P @ left.T + back @ Q @ back.T
            drawn = _draw(rng, m + back @ (drawn - F @ (m - errors.moved[index])), covariance)
            offsets.append(drawn[n:])
        whole: Array = np.array(offsets[::-1])
        return np.asarray(whole[events])


def _solved(P: Array, right: Array) -> Array:
    """Return P^-1 times ``right``; a state may be known exactly."""
    scale, scaled = _scaled(P)
    divided: Array = single.divided(right / scale[:, None], scaled)
    return np.asarray(divided.T / scale[:, None])


def _draw(rng: np.random.Generator, mean: Array, covariance: Array) -> Array:
    scale, scaled = _scaled(covariance)
    root = single.repaired_factor(scaled)
    return np.asarray(mean + scale * root.dot(rng.standard_normal(len(mean))))


def _scaled(covariance: Array) -> tuple[Array, Array]:
    """Return deviations (n,), and correlations (n, n) that have an inverse."""
    scale = np.sqrt(np.maximum(covariance.diagonal(), 1e-300))
    correlation = symmetric(covariance) / (scale[:, None] * scale)
    correlation.flat[:: len(scale) + 1] += _NUGGET
    return scale, correlation
