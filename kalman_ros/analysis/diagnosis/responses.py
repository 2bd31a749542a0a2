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

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from typing import Any

import numpy as np

from kalman_ros.core import Array

from .passage import Passage

#: A fit is about right if it changes by less than this share of its standard deviation.
_PART = 0.3
#: Number of rows of the regressors that are kept at a time, and of steps.
_ROWS, _TOGETHER = 4096, 32


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

    def steps(self) -> Iterator[Array]:
        """Yield what the columns add to the state over the step to each event (n, p)."""
        for start in range(0, len(self.effects[0]), _TOGETHER):
            at = slice(start, start + _TOGETHER)
            pairs = zip(self.effects, self.amounts)
            yield from np.concatenate([e[at, :, None] * a[at, None] for e, a in pairs], axis=2)


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
        found: dict[tuple[str, ...], list[int]] = {}
        for i, label in enumerate(self.labels):
            for size in range(len(label) + 1):
                found.setdefault(label[:size], []).append(i)
        return found

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
    p, pushes, state = len(columns.labels), columns.pushes, columns.state
    counts, offsets = columns.count(passage), columns.first_offset
    last = offsets - (0 if state is None else state.shape[2])
    first = last - (0 if pushes is None else len(pushes))
    added = repeat(0.0) if pushes is None else pushes.steps()
    seen = Counter[str]()
    gradient, information = np.zeros(p), np.zeros((p, p))
    rows = _ROWS + max(map(len, passage.whitened), default=0)
    error = np.zeros((passage.series('x').shape[1], 0))
    memory, whitened, row = np.empty(rows * p), np.empty(rows), 0
    Z = memory[:0].reshape(rows, 0)

    def take() -> None:
        count = Z.shape[1]
        gradient[:count] += Z[:row].T @ whitened[:row]
        information[:count, :count] += Z[:row].T @ Z[:row]

    each = zip(passage.events, passage.whitened, added, counts.tolist())
    for index, (event, e, pushed, count) in enumerate(each):
        if count > error.shape[1]:
            take()
            error = np.pad(error, ((0, 0), (0, count - error.shape[1])))
            Z, row = memory[: rows * count].reshape(rows, count), 0
        error = event.F.dot(error)
        error[:, first:last] += pushed
        if state is not None:
            error[:, last:offsets] += state[index]
        response = event.H.dot(error)
        row_of_sensor = seen[event.sensor]
        seen[event.sensor] += 1
        for begin, readings in columns.readings.get(event.sensor, ()):
            response[:, begin : begin + readings.shape[2]] += readings[row_of_sensor]
        if event.sensor in columns.offsets:
            at = offsets + columns.offsets[event.sensor][row_of_sensor]
            response[range(len(e)), at] += 1.0
        error -= event.K.dot(response)
        end = row + len(e)
        event.white.dot(response, out=Z[row:end])
        whitened[row:end] = e
        row = end
        if row >= _ROWS:
            take()
            row = 0
    take()
    return Responses(columns.labels, gradient, information)
