# SPDX-License-Identifier: Apache-2.0
"""Analysis along a simulated path of a scenario, where one operating point is not enough.

A bearing has no derivative at its own place, and a robot at rest cannot observe its heading:
what a nonlinear system's readings determine depends on its path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.core import Array, DesignError, Gaussian, Sensor, solve, symmetric
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.linear.single import sandwich
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.simulated_plant import SimulatedPlant

from .local_observability import readings_alone

#: The default length of a path in seconds, and its most steps.
_SECONDS, _STEPS = 60.0, 2_000
#: The slowest sensor gets N readings, unless that takes more steps.
_READINGS, _STEPS_FOR_READINGS = 20, 6_000
#: The most steps of a path.
_MOST_STEPS = 100_000
#: The model is linearised at about N points of a path.
_POINTS = 400
#: A window ends where a change of its start has grown by this factor.
_MOST_GROWTH = 1e3
#: The number of windows of a path.
_WINDOWS = 4
#: An error that is larger at the end than halfway by this factor grows.
_GROWTH = 1.05


@dataclass(frozen=True)
class Window:
    """A part of a path, and the states that its readings alone determine.

    Parameters
    ----------
    start, end
        In seconds.
    std
        Of an estimate of the state (n,) at ``start`` from these readings alone; inf if they do
        not determine it.
    observed
        The states that they determine better than the initial belief did.
    """

    start: float
    end: float
    std: Array
    observed: tuple[str, ...]


@dataclass(frozen=True)
class Path:
    """A simulated path, and how accurately its states can be estimated.

    Parameters
    ----------
    time
        Of each step (N,), in seconds.
    truth
        The states (N, n).
    std
        Of the error after the readings of each step (N, n): the posterior Cramer-Rao bound, which
        is the covariance of an EKF that is linearised about the truth.
    covariance
        At the end (n, n).
    windows
        The windows of the path.
    names
        Of the states.
    """

    time: Array
    truth: Array
    std: Array
    covariance: Array
    windows: tuple[Window, ...]
    names: tuple[str, ...]

    def observed(self, *, throughout: bool) -> tuple[str, ...]:
        """Return the states that the readings determine in every window, or in some."""
        test = all if throughout else any
        return tuple(n for n in self.names if test(n in w.observed for w in self.windows))

    @property
    def growing(self) -> tuple[str, ...]:
        """The states whose error still grows over the second half.

        What every window determines again does not grow; it varies with the path.
        """
        half, always = self.std[len(self.std) // 2], self.observed(throughout=True)
        ends = zip(self.names, half, self.std[-1])
        return tuple(n for n, a, b in ends if b > _GROWTH * a and n not in always)


def default_seconds(scenario: Scenario, usual: float = 0.0) -> float:
    """Return how long a path has to be to say something of every sensor.

    The ``usual`` duration of a run is right, too, if it takes no more steps than that may.
    """
    if 0.0 < usual * scenario.rate <= _STEPS_FOR_READINGS:
        return usual
    slowest = min(source.timed.rate for source in scenario.enabled.values())
    least = min(_SECONDS, _STEPS / scenario.rate)
    return max(least, min(_READINGS / slowest, _STEPS_FOR_READINGS / scenario.rate))


def follow(scenario: Scenario, law: Feedback | None, seconds: float, seed: int = 0) -> Path:
    """Return the analysis of the path that the plant takes from its initial state.

    It has the process noise of ``seed``, and the law acts on the true state.

    Parameters
    ----------
    scenario
        Model, sensors with their rates, and first belief.
    law
        Regulates to the equilibrium; None leaves the input at rest.
    seconds
        How long.
    seed
        Of the process noise.

    Raises
    ------
    ValueError
        If there are too few steps, or too many.
    DesignError
        If the path does not stay finite.
    """
    steps = ceil(seconds * scenario.rate - 1e-9) if 0.0 < seconds < np.inf else 0
    if not _WINDOWS <= steps <= _MOST_STEPS:
        least, most = _WINDOWS / scenario.rate, _MOST_STEPS / scenario.rate
        raise ValueError(f'duration: expected {least:g} to {most:g} s, got {seconds:g}')
    try:
        with np.errstate(all='ignore'):
            path = _known(scenario, *_simulated(scenario, law, steps, seed))
    except np.linalg.LinAlgError:
        path = None
    if path is None or not np.all(np.isfinite(path.truth)):
        raise DesignError('initial_state: the simulated path from there does not stay finite')
    return path


def _simulated(
    scenario: Scenario, law: Feedback | None, steps: int, seed: int
) -> tuple[Array, Array]:
    """Return the states (steps + 1, n) and the inputs (steps + 1, m)."""
    model = scenario.model
    plant = SimulatedPlant(model, {}, scenario.rate, scenario.initial_state, seed)
    rest = model.equilibrium
    regulator = None if law is None else Regulator(model.state, law, rest)
    states, inputs = [], []
    for _ in range(steps + 1):
        x = plant.state
        u = rest.input
        if regulator is not None:
            u = regulator.propose(x, plant.dt)
            regulator.applied(x, u, u, plant.dt)
        states.append(x)
        inputs.append(u)
        plant.step(u)
    return np.array(states), np.array(inputs)


def _known(scenario: Scenario, truth: Array, input: Array) -> Path:
    """Return the analysis of a path."""
    model, plan = scenario.model, scenario.plan
    filter: Any = ExtendedKalmanFilter(model)
    first, names = scenario.initial_belief, model.state.names
    P, over, gramian = first.covariance, np.eye(model.state.size), np.zeros_like(first.covariance)
    ends = np.linspace(0, len(truth) - 1, _WINDOWS + 1).astype(int)
    often = ceil(len(truth) / _POINTS)
    stds: list[Array] = []
    windows: list[Window] = []
    for step, x in enumerate(truth):
        near = np.abs(over).max() < _MOST_GROWTH
        for sensor in _read(scenario, step, x):
            found = filter.correct(Gaussian(x, P), sensor.measure(x), sensor)
            P = found.posterior.covariance
            if near:
                seen = found.jacobian @ over
                gramian += seen.T @ solve(sensor.covariance, seen)
        stds.append(np.sqrt(P.diagonal()))
        if step and step in ends:
            std = readings_alone(gramian, first.std)
            observed = tuple(n for n, s, b in zip(names, std, first.std) if s <= b)
            start = ends[len(windows)] * plan.dt
            windows.append(Window(start, step * plan.dt, std, observed))
            over, gramian = np.eye(len(over)), np.zeros_like(gramian)
        if step % often == 0:
            _, F, Q = filter.linearized(Gaussian(x, P), input[step], plan.dt)
        if step < len(truth) - 1:
            P = symmetric(sandwich(F, P, Q))
            over = F @ over if near else over
    time = np.asarray(np.arange(len(truth)) * plan.dt)
    return Path(time, truth, np.array(stds), P, tuple(windows), names)


def _read(scenario: Scenario, step: int, x: Array) -> Iterator[Sensor]:
    """Yield the sensors that read at a step, where they have a derivative."""
    plan = scenario.plan
    for name in plan.due(step):
        sensor = plan.sensors[name].sensor
        if np.all(np.isfinite(sensor.jacobian(x))):
            yield sensor
