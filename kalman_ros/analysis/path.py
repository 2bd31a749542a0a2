# SPDX-License-Identifier: Apache-2.0
"""Analysis along a simulated path of a scenario, where one operating point is not enough.

A bearing has no derivative at the position of its target, and a robot at rest cannot observe its
heading: the states that the readings of a nonlinear system determine depend on its path.
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

#: The default duration of a path in seconds, and the largest number of steps for it.
_SECONDS, _STEPS = 60.0, 2_000
#: The slowest sensor gets this number of readings, within the largest number of steps for them.
_READINGS, _STEPS_FOR_READINGS = 20, 6_000
#: The largest number of steps of a path.
_MOST_STEPS = 100_000
#: The model is linearised at about this number of points of a path.
_POINTS = 400
#: Readings count until a change of the state at the start of a window has grown by this factor.
_MOST_GROWTH = 1e3
#: The number of windows of a path.
_WINDOWS = 4
#: An error grows if it is larger at the end than halfway by this factor.
_GROWTH = 1.05


@dataclass(frozen=True)
class Window:
    """A window of a path, and the states that its readings alone determine.

    Parameters
    ----------
    start, end
        Start and end of the window, in seconds.
    std
        Standard deviations (n,) of an estimate of the state at ``start`` from the readings of the
        window alone; inf for a state that they do not determine.
    observed
        Names of the states that the readings determine at least as well as the initial belief.
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
        Time of each step (N,), in seconds.
    truth
        True states (N, n).
    std
        Standard deviation of the error after the readings of each step (N, n): the posterior
        Cramer-Rao bound, which is the covariance of an EKF that is linearised about the truth.
    covariance
        Covariance of the error at the end (n, n).
    windows
        Windows of the path.
    names
        Names of the states.
    """

    time: Array
    truth: Array
    std: Array
    covariance: Array
    windows: tuple[Window, ...]
    names: tuple[str, ...]

    def observed(self, *, throughout: bool) -> tuple[str, ...]:
        """Return the states that the readings determine in every window, or in any window."""
        test = all if throughout else any
        return tuple(n for n in self.names if test(n in w.observed for w in self.windows))

    @property
    def growing(self) -> tuple[str, ...]:
        """Names of the states whose error still grows in the second half of the path.

        The error of a state that every window determines varies with the path, but does not grow.
        """
        half, always = self.std[len(self.std) // 2], self.observed(throughout=True)
        ends = zip(self.names, half, self.std[-1])
        return tuple(n for n, a, b in ends if b > _GROWTH * a and n not in always)


def default_seconds(scenario: Scenario, usual: float = 0.0) -> float:
    """Return the duration of a path, in seconds, that has enough readings of every sensor.

    It is the ``usual`` duration of a run if that duration is positive and has few enough steps.
    """
    if 0.0 < usual * scenario.rate <= _STEPS_FOR_READINGS:
        return usual
    slowest = min(source.timed.rate for source in scenario.enabled.values())
    least = min(_SECONDS, _STEPS / scenario.rate)
    return max(least, min(_READINGS / slowest, _STEPS_FOR_READINGS / scenario.rate))


def follow(scenario: Scenario, law: Feedback | None, seconds: float, seed: int = 0) -> Path:
    """Simulate the path of the plant from its initial state, and analyse it.

    The control law acts on the true state.

    Parameters
    ----------
    scenario
        Model, sensors with their rates, and initial belief.
    law
        Control law that regulates to the equilibrium; None holds the input of the equilibrium.
    seconds
        Duration of the path.
    seed
        Seed of the process noise.

    Raises
    ------
    ValueError
        If there are too few or too many steps.
    DesignError
        If the path does not stay finite.
    """
    steps = ceil(seconds * scenario.rate - 1e-9) if 0.0 < seconds < np.inf else 0
    if not _WINDOWS <= steps <= _MOST_STEPS:
        least, most = _WINDOWS / scenario.rate, _MOST_STEPS / scenario.rate
        raise ValueError(f'duration: expected {least:g} to {most:g} s, got {seconds:g}')
    try:
        with np.errstate(all='ignore'):
            path = _analyse(scenario, *_simulate(scenario, law, steps, seed))
    except np.linalg.LinAlgError:
        path = None
    if path is None or not np.all(np.isfinite(path.truth)):
        raise DesignError('initial_state: the simulated path from there does not stay finite')
    return path


def _simulate(
    scenario: Scenario, law: Feedback | None, steps: int, seed: int
) -> tuple[Array, Array]:
    """Return the simulated states (steps + 1, n) and inputs (steps + 1, m)."""
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


def _analyse(scenario: Scenario, truth: Array, input: Array) -> Path:
    """Return the analysis of the path with these states (N, n) and inputs (N, m)."""
    model, plan = scenario.model, scenario.plan
    filter: Any = ExtendedKalmanFilter(model)
    first, names = scenario.initial_belief, model.state.names
    P, transition, gramian = (
        first.covariance,
        np.eye(model.state.size),
        np.zeros_like(first.covariance),
    )
    ends = np.linspace(0, len(truth) - 1, _WINDOWS + 1).astype(int)
    interval = ceil(len(truth) / _POINTS)
    stds: list[Array] = []
    windows: list[Window] = []
    for step, x in enumerate(truth):
        reliable = np.abs(transition).max() < _MOST_GROWTH
        for sensor in _usable_sensors(scenario, step, x):
            correction = filter.correct(Gaussian(x, P), sensor.measure(x), sensor)
            P = correction.posterior.covariance
            if reliable:
                sensitivity = correction.jacobian @ transition
                gramian += sensitivity.T @ solve(sensor.covariance, sensitivity)
        stds.append(np.sqrt(P.diagonal()))
        if step and step in ends:
            std = readings_alone(gramian, first.std)
            observed = tuple(n for n, s, b in zip(names, std, first.std) if s <= b)
            start = ends[len(windows)] * plan.dt
            windows.append(Window(start, step * plan.dt, std, observed))
            transition, gramian = np.eye(len(transition)), np.zeros_like(gramian)
        if step % interval == 0:
            _, F, Q = filter.linearized(Gaussian(x, P), input[step], plan.dt)
        if step < len(truth) - 1:
            P = symmetric(sandwich(F, P, Q))
            transition = F @ transition if reliable else transition
    time = np.asarray(np.arange(len(truth)) * plan.dt)
    return Path(time, truth, np.array(stds), P, tuple(windows), names)


def _usable_sensors(scenario: Scenario, step: int, x: Array) -> Iterator[Sensor]:
    """Yield the sensors that read at a step, unless their Jacobian at x is not finite."""
    plan = scenario.plan
    for name in plan.due(step):
        sensor = plan.sensors[name].sensor
        if np.all(np.isfinite(sensor.jacobian(x))):
            yield sensor
