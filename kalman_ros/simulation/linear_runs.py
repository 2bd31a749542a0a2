# SPDX-License-Identifier: Apache-2.0
"""Many runs of a loop in which all is linear: one matrix product a step for all of them.

The effect of a step on truth and estimate, and the errors in it, are linear in both and in the
noise, with matrices that are the same in every run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Sensor, is_due, ratio
from kalman_ros.estimators.gain_schedule import GainSchedule
from kalman_ros.scenario import Scenario

from .batch_loop import Loop
from .batch_plant import BatchNoise
from .loop_law import Law
from .noise import root
from .run_statistics import Outcomes

#: Number of steps whose results are squared and summed together, so that they fit a cache.
_BLOCK = 8


def is_linear(loop: Loop) -> bool:
    """Return whether a loop has no angles, gates or limits, and nothing that varies in time."""
    real, believed, law = loop.scenario, loop.believed, loop.answer
    n = real.model.state.size
    sources = (*real.enabled.values(), *believed.sensors.values())
    return (
        all(
            _is_linear(scenario) and scenario.model.state.size == n
            for scenario in (real, believed)
        )
        and all(_is_proportional(source.sensor, n) for source in sources)
        and not any(source.gate < 1.0 or source.weights for source in believed.sensors.values())
        and (law is None or (isinstance(law, Law) and law.proportional))
        and loop.command is None
        and loop.arrives is None
        and loop.faults is None
    )


def _is_linear(scenario: Scenario) -> bool:
    model = scenario.model
    curved = model.state.turns or np.concatenate(model.equilibrium).any()
    return model.is_linear and not curved


def _is_proportional(sensor: Sensor, n: int) -> bool:
    return sensor.linear and not sensor.output.turns and not sensor.measure(np.zeros(n)).any()


class LinearStep(NamedTuple):
    """The matrix of a step, its readings, and the covariances of its estimates and predictions."""

    matrix: Array
    due: tuple[str, ...]
    covariance: Array
    predicted: Array


@dataclass(frozen=True, eq=False)
class LinearRuns:
    """The runs of a loop that `is_linear`.

    Parameters
    ----------
    loop
        Loop that is run.
    weight
        Weight (n + m, n + m) of the stacked state and input in the cost of a step; or None.
    first
        First step that counts.
    schedule
        Gain schedule of the filter.
    """

    loop: Loop
    weight: Array | None
    first: int
    schedule: GainSchedule
    _known: dict[tuple[bytes, tuple[str, ...], float], LinearStep] = field(
        default_factory=dict, init=False, repr=False
    )

    def outcomes(self, seeds: Sequence[int]) -> Outcomes | None:
        """Return the outcomes of the runs with these seeds; None if a number is not finite.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a covariance cannot be computed.
        """
        real, steps = self.loop.scenario, self.loop.steps
        x, x_hat = real.initial_state, self.loop.believed.initial_belief.mean
        n, shares = len(x), self._shares
        noise = {'': BatchNoise(seeds, 'process', n, steps)}
        for name, sensor_source in real.enabled.items():
            k, draws = sensor_source.sensor.output.size, ceil(steps * shares[name]) + 1
            noise[name] = BatchNoise(seeds, f'sensor {name}', k, draws)
        places = self._rows([numbers.size for numbers in noise.values()])
        sums = _Sums(self, len(seeds), places[-1].stop)
        sums.start(np.concatenate((x, x_hat)))
        for k, step in enumerate(self._steps):
            before, after = sums.room(k)
            for (name, source), place in zip(noise.items(), places):
                if not name or name in step.due:
                    before[place] = source.draw().T
            np.dot(step.matrix, before, out=after)
        truth = before[places[-1].stop :][:n].T.copy()
        return sums.outcomes(truth)

    @cached_property
    def _steps(self) -> list[LinearStep]:
        """Steps of a run."""
        shares, P, steps = self._shares, self.loop.believed.initial_belief.covariance, []
        for k in range(self.loop.steps):
            due = tuple(name for name in shares if is_due(k, shares[name]))
            steps.append(self._step(P, due, self._time(k + 1) - self._time(k)))
            P = steps[-1].predicted
        return steps

    @property
    def _shares(self) -> dict[str, Fraction]:
        """Share of the steps in which each sensor reads."""
        real = self.loop.scenario
        return {name: ratio(source.timed.rate, real.rate) for name, source in real.enabled.items()}

    def _time(self, k: int) -> int:
        """Return the time of a step in nanoseconds, as `BatchPlant` does."""
        return round(k * (1.0 / self.loop.scenario.rate) * 1e9)

    @staticmethod
    def _rows(widths: Sequence[int]) -> list[slice]:
        ends = np.cumsum(widths).tolist()
        return [slice(end - width, end) for end, width in zip(ends, widths)]

    def _step(self, P: Array, due: tuple[str, ...], nanoseconds: int) -> LinearStep:
        """Return the step from predictions of covariance ``P``, with the readings ``due``."""
        key = P.tobytes(), due, nanoseconds * 1e-9
        step = self._known.get(key)
        if step is None:
            step = self._known[key] = self._composed(P, due, nanoseconds * 1e-9)
        return step

    def _composed(self, P: Array, due: tuple[str, ...], dt: float) -> LinearStep:
        """Compose a step: each vector below is a matrix that maps the vectors before it to it."""
        real, believed = self.loop.scenario, self.loop.believed
        n, sensors = real.model.state.size, [source.sensor for source in real.enabled.values()]
        places = self._rows([n, *(sensor.output.size for sensor in sensors), n, n])
        w, *v, x, x_hat = (np.eye(places[-1].stop)[place] for place in places)
        innovations = []
        for name, sensor, noise in zip(real.enabled, sensors, v):
            innovation = np.zeros_like(noise)
            if name in due:
                believed_sensor = believed.sensors[name].sensor
                correction = self.schedule.correction(P, believed_sensor)
                assert correction is not None
                y = sensor.jacobian(np.zeros(n)) @ x + root(sensor.covariance) @ noise
                residual = y - believed_sensor.jacobian(np.zeros(n)) @ x_hat
                x_hat, P = x_hat + correction.gain @ residual, correction.covariance
                innovation = correction.whitening @ residual
            innovations.append(innovation)
        law = self.loop.answer
        K = law.feedback.gain if isinstance(law, Law) else np.zeros((real.model.input.size, n))
        u = -K @ x_hat
        plant = real.model.sampled(dt)  # type: ignore[attr-defined]
        filter = self.schedule.prediction(P, dt)
        error = x - x_hat
        price = [] if self.weight is None else [root(self.weight).T @ np.vstack((x, u))]
        noise = root(real.model.noise_covariance(*real.model.equilibrium, 1.0 / real.rate)) @ w
        moved = plant.F @ x + plant.G @ u + noise, filter.F @ x_hat + filter.G @ u
        white = self.schedule.whitening(P) @ error
        matrix = np.vstack((*moved, error, white, *innovations, *price))
        return LinearStep(matrix, due, P, filter.covariance)


class _Sums:
    """The results of steps, and sums of their squares, over steps and over runs.

    The noise of a step is followed by the results of the last step, which begin with its states,
    so that a step multiplies one array.
    """

    def __init__(self, loops: LinearRuns, runs: int, noise: int) -> None:
        loop = loops.loop
        n, steps = loop.scenario.model.state.size, loop.steps
        sensors = {name: source.sensor for name, source in loop.scenario.enabled.items()}
        self._degrees = {name: sensor.output.size for name, sensor in sensors.items()}
        price = 0 if loops.weight is None else len(loops.weight)
        self._rows = loops._rows([2 * n, n, n, *self._degrees.values(), price])
        self._names, self._first, self._runs = list(loop.believed.sensors), loops.first, runs
        self._steps = np.zeros((_BLOCK + 1, noise + self._rows[-1].stop, runs))
        self._results, self._before = self._steps[:, noise:], self._steps[:, : noise + 2 * n]
        self._k, self._waiting = 0, 0
        self._squares, self._nees = np.zeros((n, runs)), np.zeros(runs)
        self._nis = {name: np.zeros(runs) for name in sensors}
        self._known = loops._steps
        self._cost = np.zeros(runs) if price else np.empty(0)
        self._step_squares = np.zeros((steps, n))
        self._step_nees = np.zeros(steps)

    def start(self, state: Array) -> None:
        """Begin with a state (2n,) of truth and estimate in all runs."""
        self._results[0, self._rows[0]] = state[:, np.newaxis]

    def room(self, k: int) -> tuple[Array, Array]:
        """Return noise and states before step k, and the array for its results (rows, runs)."""
        if self._waiting == _BLOCK or k == self._first:
            self._add()
        self._waiting += 1
        return self._before[self._waiting - 1], self._results[self._waiting]

    def _add(self) -> None:
        """Add the waiting results."""
        first, last = self._k, self._k + self._waiting
        results = self._results[1 : self._waiting + 1]
        _, error, white, *others = (results[:, place] for place in self._rows)
        self._step_squares[first:last] = np.einsum('kir,kir->ki', error, error)
        self._step_nees[first:last] = np.einsum('kir,kir->k', white, white)
        if first >= self._first:
            self._squares += np.einsum('kir,kir->ir', error, error)
            self._nees += np.einsum('kir,kir->r', white, white)
            for total, values in zip((*self._nis.values(), self._cost), others):
                if total.size:
                    total += np.einsum('kir,kir->r', values, values)
        self._results[0, self._rows[0]] = self._results[self._waiting, self._rows[0]]
        self._k, self._waiting = last, 0

    def outcomes(self, truth: Array) -> Outcomes | None:
        """Return the outcomes; None if a number is not finite."""
        error = self._results[self._waiting, self._rows[1]].T.copy()
        self._add()
        steps, counted = self._k, self._k - self._first
        if not (np.isfinite(self._step_nees).all() and np.isfinite(self._cost).all()):
            return None
        nis = {name: np.full(self._runs, np.nan) for name in self._names}
        for name, total in self._nis.items():
            read = sum(name in step.due for step in self._known[self._first :])
            if read:
                nis[name] = total / (read * self._degrees[name])
        variance = np.array([step.covariance.diagonal() for step in self._known])
        return Outcomes(
            np.ascontiguousarray(self._squares.T) / counted,
            self._nees / (counted * error.shape[1]),
            nis,
            self._cost / counted,
            np.zeros(self._runs),
            error,
            np.broadcast_to(np.sqrt(variance[-1]), error.shape).copy(),
            truth,
            np.full(steps, self._runs),
            self._step_squares,
            variance * self._runs,
            self._step_nees,
        )
