# SPDX-License-Identifier: Apache-2.0
"""How innovations respond to faults, to first order, and how well that explains them.

A fault adds d to a step of the state, or c to a reading. With the gains K of a filter that does
not know of it, the mean error e of the prediction and of the innovation follow

    e <- F e + d,    nu = H e + c,    e <- e - K nu,

linear in the size of the fault (A. Willsky and H. Jones, A Generalized Likelihood Ratio Approach
to the Detection and Estimation of Jumps in Linear Systems, IEEE Trans. Automatic Control 21(1),
1976; R. Mehra and J. Peschon, An Innovations Approach to Fault Detection and Diagnosis in Dynamic
Systems, Automatica 7(5), 1971). All faults are followed at once, a column each; whitened by S
they are the regressors of the whitened innovations, which are N(0, 1) without a fault.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array

from .passage import Passage


@dataclass(frozen=True)
class Columns:
    """Faults of unit size: what each adds, event by event.

    Parameters
    ----------
    labels
        One a column: (family, subject, detail).
    readings
        By sensor, what columns ``first`` to ``first + p`` add to its readings: (first, (E, k, p))
        in the order of its events.
    state
        What the last columns add to the state over the step to each event (E, n, p).
    """

    labels: Sequence[tuple[str, ...]]
    readings: Mapping[str, tuple[int, Array]]
    state: Array


@dataclass(frozen=True)
class Responses:
    """The normal equations of a regression of whitened innovations on the response of faults.

    Parameters
    ----------
    labels
        One a column.
    gradient
        Z'e (p,), with Z the whitened responses.
    information
        Z'Z (p, p), the Fisher information.
    """

    labels: Sequence[tuple[str, ...]]
    gradient: Array
    information: Array

    def columns(self, *start: str) -> list[int]:
        """Return the columns whose label begins so."""
        return [i for i, label in enumerate(self.labels) if label[: len(start)] == start]

    def fit(self, basis: Array, columns: Sequence[int]) -> Fit:
        """Return the fit of ``columns`` tied together by a ``basis`` (columns, q)."""
        g = basis.T @ self.gradient[columns]
        M = basis.T @ self.information[np.ix_(columns, columns)] @ basis
        return fitted(g, M)

    def alone(self, column: int) -> Fit:
        """Return the fit of one column."""
        return self.fit(np.ones((1, 1)), [column])


@dataclass(frozen=True)
class Fit:
    """Sizes of faults (q,), their covariance (q, q), and the gain in -2 log likelihood."""

    size: Array
    covariance: Array
    gain: float

    @property
    def std(self) -> Array:
        """Standard deviations of the sizes (q,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))


def fitted(gradient: Array, information: Array) -> Fit:
    """Return the least squares fit; directions without information are left at zero."""
    scale = np.sqrt(np.maximum(information.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    least = 1e-8 * max(values[-1], 1e-300)
    inverse = np.where(values > least, 1.0 / np.maximum(values, least), 0.0)
    covariance = (vectors * inverse) @ vectors.T / np.outer(scale, scale)
    size = covariance @ gradient
    return Fit(size, covariance, float(gradient @ size))


def responses(found: Passage, columns: Columns) -> Responses:
    """Return how well the columns explain the innovations of a passage."""
    p, n = len(columns.labels), columns.state.shape[1]
    own = p - columns.state.shape[2]
    error = np.zeros((n, p))
    seen = dict.fromkeys(columns.readings, 0)
    e = np.concatenate([np.zeros(0), *found.whitened])
    Z, row = np.zeros((len(e), p)), 0
    for event, pushed in zip(found.events, columns.state):
        error = event.F.dot(error)
        error[:, own:] += pushed
        response = event.H.dot(error)
        first, readings = columns.readings[event.sensor]
        at = seen[event.sensor]
        seen[event.sensor] = at + 1
        response[:, first : first + readings.shape[2]] += readings[at]
        error -= event.K.dot(response)
        event.white.dot(response, out=Z[row : row + len(response)])
        row += len(response)
    return Responses(columns.labels, Z.T @ e, Z.T @ Z)
