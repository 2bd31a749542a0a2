# SPDX-License-Identifier: Apache-2.0
"""Responses of innovations to faults, to first order, and regressions on them.

A fault adds d to a step of the state, or c to a reading. With the gains K of a filter without a
model of the fault, the mean error e of the prediction and the mean innovation nu follow

    e <- F e + d,    nu = H e + c,    e <- e - K nu,

linear in the size of the fault (A. Willsky and H. Jones, A Generalized Likelihood Ratio Approach
to the Detection and Estimation of Jumps in Linear Systems, IEEE Trans. Automatic Control 21(1),
1976; R. Mehra and J. Peschon, An Innovations Approach to Fault Detection and Diagnosis in Dynamic
Systems, Automatica 7(5), 1971). All faults are propagated at once, one column each. Whitened by S,
the columns are the regressors of the whitened innovations, which are N(0, 1) without a fault.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from kalman_ros.compiled.recursions import respond
from kalman_ros.core import Array

from .passage import Passage

#: A fit is about right if it changes by less than this share of its standard deviation.
_PART = 0.3
#: Number of readings whose regressors are computed at a time.
_TOGETHER = 256


@dataclass(frozen=True)
class Pushes:
    """The effect of p columns on the state, each by one of m inputs.

    Parameters
    ----------
    effects
        Effect of a unit of each input over the step to each event (E, n), by input.
    amounts
        How much each column of an input pushes in each step (E, p_i), by input.
    """

    effects: Sequence[Array]
    amounts: Sequence[Array]

    def __len__(self) -> int:
        return sum(amount.shape[1] for amount in self.amounts)

    def between(self, begin: int, end: int) -> Array:
        """Return what the columns add to the state over the steps to some events (E, n, p)."""
        at, pairs = slice(begin, end), zip(self.effects, self.amounts)
        return np.concatenate([e[at, :, None] * a[at, None] for e, a in pairs], axis=2)


@dataclass(frozen=True)
class Columns:
    """The effect of faults of unit size at each event.

    Parameters
    ----------
    labels
        Label of each column: (family, subject, detail).
    readings
        Effects of the columns ``first`` to ``first + p`` on the readings, by sensor: several
        (first, (E, k, p)) in the order of the events of the sensor.
    offsets
        Which of the last columns adds 1 to each coordinate of each reading (E, k), by sensor; a
        later column belongs to a later reading.
    pushes
        Effect of the columns before those of ``state``.
    state
        Effect of the columns before the offsets on the state over the step to each event
        (E, n, p).
    """

    labels: Sequence[tuple[str, ...]]
    readings: Mapping[str, Sequence[tuple[int, Array]]]
    offsets: Mapping[str, Any] = field(default_factory=dict)
    pushes: Pushes | None = None
    state: Array | None = None

    @property
    def first_offset(self) -> int:
        """Number of columns before those of the offsets."""
        return sum(label[0] != 'offset' for label in self.labels)

    def count(self, passage: Passage) -> Any:
        """Return of how many columns there is an effect up to each event (E,)."""
        last = np.zeros(len(passage.events), dtype=int)
        for name, columns in self.offsets.items():
            last[passage.of(name)] = columns.max(axis=1) + 1
        return self.first_offset + np.maximum.accumulate(last)

    def on_readings(self, passage: Passage, begin: int, end: int, width: int) -> Array:
        """Return the effect of the first columns on the numbers of some readings (R, width)."""
        rows = passage.rows
        first = rows.first[begin]
        Z = np.zeros((int(rows.first[end - 1] + rows.sizes[end - 1] - first), width))
        for name in passage.names:
            of = passage.of(name)
            some = slice(*np.searchsorted(of, (begin, end)).tolist())
            at = rows.first[of[some]] - first
            if not len(at):
                continue
            at = (at[:, None] + np.arange(rows.sizes[of[0]])).ravel()
            for start, readings in self.readings.get(name, ()):
                count = readings.shape[2]
                Z[at, start : start + count] += readings[some].reshape(-1, count)
            if name in self.offsets:
                Z[at, self.first_offset + self.offsets[name][some].ravel()] += 1.0
        return Z

    def on_steps(self, begin: int, end: int, size: int) -> tuple[Array, int]:
        """Return the effect of columns on the steps to some readings (E, n, q), and the first."""
        parts = [] if self.pushes is None else [self.pushes.between(begin, end)]
        parts += [] if self.state is None else [self.state[begin:end]]
        added = np.concatenate([np.zeros((end - begin, size, 0)), *parts], axis=2)
        return added, self.first_offset - added.shape[2]


@dataclass(frozen=True)
class Responses:
    """The normal equations of a regression of whitened innovations on responses to faults.

    Parameters
    ----------
    labels
        Label of each column.
    gradient
        Z'e (p,), where Z has the whitened responses.
    information
        Fisher information Z'Z (p, p).
    """

    labels: Sequence[tuple[str, ...]]
    gradient: Array
    information: Array

    def columns(self, *start: str) -> list[int]:
        """Return the columns with a label that begins with ``start``."""
        return list(self._by_start.get(start, ()))

    @cached_property
    def _by_start(self) -> dict[tuple[str, ...], list[int]]:
        """The columns by each beginning of their labels."""
        columns: dict[tuple[str, ...], list[int]] = {}
        for i, label in enumerate(self.labels):
            for size in range(len(label) + 1):
                columns.setdefault(label[:size], []).append(i)
        return columns

    def fit(self, basis: Array, columns: Sequence[int]) -> Fit:
        """Return the fit of ``columns`` in the subspace of a ``basis`` (columns, q)."""
        g = basis.T @ self.gradient[columns]
        M = basis.T @ self.information[np.ix_(columns, columns)] @ basis
        return fitted(g, M)

    def together(self, columns: Sequence[int]) -> Fit:
        """Return the fit of some columns, each with its size."""
        return fitted(self.gradient[columns], self.information[np.ix_(columns, columns)])

    def first(self, *start: str) -> Fit | None:
        """Return the fit of the first column whose label begins with ``start``; None without."""
        columns = self._by_start.get(start)
        return self.alone(columns[0]) if columns else None

    def alone(self, column: int) -> Fit:
        """Return the fit of one column."""
        return self.fit(np.ones((1, 1)), [column])


@dataclass(frozen=True)
class Fit:
    """The sizes of faults (q,), their covariance (q, q), and the gain in -2 log likelihood."""

    size: Array
    covariance: Array
    gain: float

    @property
    def std(self) -> Array:
        """Standard deviations of the sizes (q,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def remains(self) -> bool:
        """Whether a size is more than a part of its standard deviation."""
        return bool((np.abs(self.size) > _PART * self.std).any())


def fitted(gradient: Array, information: Array) -> Fit:
    """Return the least squares fit, which is zero in directions without information."""
    scale = np.sqrt(np.maximum(information.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    least = 1e-8 * max(values[-1], 1e-300)
    inverse = np.where(values > least, 1.0 / np.maximum(values, least), 0.0)
    covariance = (vectors * inverse) @ vectors.T / np.outer(scale, scale)
    size = covariance @ gradient
    return Fit(size, covariance, float(gradient @ size))


def responses(passage: Passage, columns: Columns) -> Responses:
    """Return the regression of the innovations of a filter pass on the columns."""
    p, counts = len(columns.labels), columns.count(passage)
    gradient, information = np.zeros(p), np.zeros((p, p))
    error = np.zeros((passage.series('x').shape[1], 0))
    for begin in range(0, len(counts), _TOGETHER):
        end = min(begin + _TOGETHER, len(counts))
        rows, width = passage.rows.between(begin, end), int(counts[end - 1])
        error = np.pad(error, ((0, 0), (0, width - error.shape[1])))
        Z = columns.on_readings(passage, begin, end, width)
        respond(rows, *columns.on_steps(begin, end, len(error)), error, Z)
        gradient[:width] += Z.T @ rows.innovation
        information[:width, :width] += Z.T @ Z
    return Responses(columns.labels, gradient, information)
