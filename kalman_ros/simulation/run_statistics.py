# SPDX-License-Identifier: Apache-2.0
"""Statistics of many runs: for each run its averages, for each step averages over the runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array
from kalman_ros.estimators.batch_estimator import BatchEstimator
from kalman_ros.estimators.filter import Correction
from kalman_ros.linear.batched import factor, whitened

from .batch_loop import Loop
from .trajectory import Trajectory


@dataclass(frozen=True)
class Outcomes:
    """The outcomes of N runs. Averages in time begin at the first step that counts.

    Parameters
    ----------
    squared_error
        Mean squares of each run's errors (N, n).
    nees
        Mean of each run's normalised errors squared, divided by n (N,).
    nis
        The same for the innovations, by sensor; NaN without readings.
    cost
        Mean cost of a step (N,); empty without an input.
    limited
        Share of the steps in which a limit changed the input (N,).
    final_error, final_std, final_state
        Error, claimed deviations and truth at the end (N, n).
    count
        Number of runs whose numbers are finite at each step (S,); the fields below are sums over
        these runs.
    step_squares, step_variance
        Squared errors, and claimed variances (S, n).
    step_nees
        Normalised errors squared (S,).
    """

    squared_error: Array
    nees: Array
    nis: Mapping[str, Array]
    cost: Array
    limited: Array
    final_error: Array
    final_std: Array
    final_state: Array
    count: npt.NDArray[np.int64]
    step_squares: Array
    step_variance: Array
    step_nees: Array

    @staticmethod
    def joined(parts: Sequence[Outcomes]) -> Outcomes:
        """Return the outcomes of all the runs of ``parts``, in their order."""
        columns: dict[str, Any] = {}
        for field in fields(Outcomes):
            values = [getattr(part, field.name) for part in parts]
            if field.name == 'nis':
                columns['nis'] = {
                    name: np.concatenate([value[name] for value in values]) for name in values[0]
                }
            elif field.name in _OF_STEPS:
                columns[field.name] = sum(values[1:], start=values[0])
            else:
                columns[field.name] = np.concatenate(values)
        return Outcomes(**columns)


#: Fields that are summed over runs.
_OF_STEPS = ('count', 'step_squares', 'step_variance', 'step_nees')


class RunStatistics:
    """Accumulator of the `Outcomes` of a batch.

    Parameters
    ----------
    loop
        Loops that are observed.
    runs
        Number of runs.
    weight
        Weight (n + m, n + m) of the stacked state and input in the cost of a step; or None.
    first
        First step that counts.
    """

    def __init__(self, loop: Loop, runs: int, weight: Array | None, first: int) -> None:
        model = loop.scenario.model
        self._space, self._rest = model.state, model.equilibrium
        n, m, steps = model.state.size, model.input.size, loop.steps
        self._first, self._counted = first, steps - first
        self._weight = weight
        self._stacked = np.zeros((n + m, runs))
        self._k = 0
        self._squares = np.zeros((n, runs)).T
        self._nees, self._cost = np.zeros(runs), np.zeros(runs)
        self._nis = {name: np.zeros(runs) for name in loop.believed.sensors}
        sensors = loop.believed.sensors
        self._degrees = {name: source.sensor.output.size for name, source in sensors.items()}
        self._read = {name: np.zeros(runs, dtype=int) for name in sensors}
        self._count = np.zeros(steps, dtype=np.int64)
        self._step_squares, self._step_variance = np.zeros((steps, n)), np.zeros((steps, n))
        self._step_nees = np.zeros(steps)

    def reading(self, name: str, y: Array, correction: Correction) -> None:
        """Add the innovations of a sensor, without those that are not finite."""
        if self._k < self._first:
            return
        nis = correction.nis
        total = nis.sum()
        if np.isfinite(total):
            self._nis[name] += nis
            self._read[name] += 1
        else:
            finite = np.isfinite(nis)
            self._nis[name] += np.where(finite, nis, 0.0)
            self._read[name] += finite

    def step(self, estimator: BatchEstimator, truth: Array, u: Array) -> None:
        """Add the errors and the cost of a step."""
        k, (estimate, P) = self._k, estimator.belief
        error = self._space.subtract(truth, estimate)
        squares = error * error
        z = estimator.whitened(error)
        nees = np.einsum('ij,ij->i', z, z)
        total = float(nees.sum())
        variance = P.diagonal(axis1=-2, axis2=-1)
        if np.isfinite(total):
            self._count[k] = len(nees)
            self._step_squares[k] = squares.sum(axis=0)
            self._step_nees[k] = total
        else:
            finite = np.isfinite(nees)
            self._count[k] = np.count_nonzero(finite)
            self._step_squares[k] = squares[finite].sum(axis=0)
            self._step_nees[k] = nees[finite].sum()
            variance = variance[finite] if variance.ndim == 2 else variance
        alike = variance.ndim == 1
        self._step_variance[k] = variance * self._count[k] if alike else variance.sum(axis=0)
        if k >= self._first:
            self._squares += squares
            self._nees += nees
            if self._weight is not None:
                self._cost += self._price(self._weight, truth, u)
        self._k += 1
        self._last = error, P, truth

    def _price(self, weight: Array, truth: Array, u: Array) -> Array:
        """Return the cost (runs,) of a step."""
        n = truth.shape[1]
        self._stacked[:n] = self._space.subtract(truth, self._rest.state).T
        self._stacked[n:] = (u - self._rest.input).reshape(-1, u.shape[-1]).T
        return np.asarray(np.einsum('ij,ij->j', self._stacked, weight.dot(self._stacked)))

    def outcomes(self, limited: Array | int) -> Outcomes:
        """Return the outcomes, after all steps.

        Parameters
        ----------
        limited
            Number of steps in which a limit changed the input (runs,); one number for all.
        """
        error, P, truth = self._last
        n, steps = error.shape[1], len(self._count)
        with np.errstate(invalid='ignore'):
            nis = {
                name: total / (self._read[name] * self._degrees[name])
                for name, total in self._nis.items()
            }
            std = np.sqrt(P.diagonal(axis1=-2, axis2=-1))
        return Outcomes(
            np.ascontiguousarray(self._squares) / self._counted,
            self._nees / (self._counted * n),
            nis,
            self._cost / self._counted if self._weight is not None else np.empty(0),
            np.broadcast_to(np.asarray(limited) / steps, len(error)).copy(),
            np.ascontiguousarray(error),
            np.broadcast_to(std, error.shape).copy(),
            np.ascontiguousarray(truth),
            self._count,
            self._step_squares,
            self._step_variance,
            self._step_nees,
        )


@np.errstate(all='ignore')
def outcomes_of(
    loop: Loop, run: Trajectory, weight: Array | None, first: int, limited: int
) -> Outcomes:
    """Return the outcomes of one run, as `RunStatistics` counts them."""
    space, rest = loop.scenario.model.state, loop.scenario.model.equilibrium
    error = space.subtract(run.truth, run.estimate)
    variance = run.covariance.diagonal(axis1=1, axis2=2)
    squares = error**2
    z = whitened(factor(run.covariance), error)
    normalised = np.einsum('ij,ij->i', z, z)
    z = np.hstack((space.subtract(run.truth, rest.state), run.input - rest.input))
    finite = np.isfinite(normalised)
    nis = {}
    for name, source in loop.believed.sensors.items():
        innovations = run.innovations[name]
        values = innovations.nis[innovations.time * loop.scenario.rate > first - 0.5]
        mean = values.mean() if len(values) else np.nan
        nis[name] = np.array([mean / source.sensor.output.size])
    return Outcomes(
        squares[first:].mean(axis=0)[np.newaxis],
        np.array([normalised[first:].mean() / space.size]),
        nis,
        np.empty(0)
        if weight is None
        else np.array([np.einsum('ki,ij,kj->k', z, weight, z)[first:].mean()]),
        np.array([limited / len(run.time)]),
        error[-1:],
        np.sqrt(variance[-1:]),
        run.truth[-1:],
        finite.astype(np.int64),
        np.where(finite[:, np.newaxis], squares, 0.0),
        np.where(finite[:, np.newaxis], variance, 0.0),
        np.where(finite, normalised, 0.0),
    )
