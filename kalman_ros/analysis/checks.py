# SPDX-License-Identifier: Apache-2.0
"""Comparison of a recorded LQG loop with theory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, isnan, log, nan

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.identification import fit
from kalman_ros.control.lqr import Cost
from kalman_ros.control.separation import LqgLoop
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array, Space
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.linear.periodic import Readings
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback, price
from kalman_ros.simulation.trajectory import Trajectory

#: The largest probability that a correct system fails a run, over all checks together.
MISS = 5e-4


@dataclass(frozen=True)
class Check:
    """One measured number with its expectation and bounds.

    Poles have no bounds (NaN): they pass or fail with their dynamics.
    """

    name: str
    unit: str
    expected: complex
    measured: complex
    low: float
    high: float
    passed: bool

    @property
    def counts(self) -> bool:
        """Whether it has bounds; poles have those of their dynamics."""
        return not isnan(self.low)


@dataclass(frozen=True)
class LqgTheory:
    """A scenario's law and the theory of its loop."""

    feedback: Feedback
    cost: Cost
    loop: LqgLoop
    dt: float

    @property
    def expected_cost(self) -> float:
        """The mean cost per second."""
        return self.loop.mean_cost(self.cost) / self.dt

    @property
    def settling_time(self) -> float:
        """Seconds after which a thousandth of the initial error is left."""
        poles = np.concatenate((self.loop.regulator_poles, self.loop.estimator_poles))
        slowest = float(np.max(np.abs(poles)))
        return log(1e-3) / log(slowest) * self.dt

    @property
    def settled(self) -> int:
        """The step, at the beginning of a period, from which a run is evaluated."""
        period = len(self.loop.schedule)
        return period * ceil(self.settling_time / self.dt / period)

    @property
    def least_steps(self) -> int:
        """The number of steps after that which a run must have to be checked."""
        return max(200, 20 * len(self.loop.schedule))

    @property
    def least_duration(self) -> float:
        """The least duration of a run, in seconds, that can be checked."""
        return (self.settled + self.least_steps) * self.dt


def schedule(scenario: Scenario, x: Array) -> list[Readings]:
    """Return the readings at each step of a period, with sensors linearised about x (n,)."""
    plan = scenario.plan
    phases = []
    for step in range(plan.period):
        due = [plan.sensors[name].sensor for name in plan.due(step)]
        C = np.vstack([np.empty((0, x.size)), *(sensor.jacobian(x) for sensor in due)])
        phases.append(Readings(C, _together(sensor.covariance for sensor in due)))
    return phases


def _together(covariances: Iterable[Array]) -> Array:
    """Return independent covariances as one (k, k); k may be 0."""
    return np.asarray(block_diag(np.empty((0, 0)), *covariances), dtype=float)


def theory(scenario: Scenario) -> LqgTheory:
    """Return the law of a scenario's loop and its statistics in steady state.

    Raises
    ------
    DesignError
        If the loop cannot be stabilised, or the sensors do not keep the error bounded.
    """
    law = feedback(scenario)
    model = scenario.model
    dt, rest = 1.0 / scenario.rate, model.equilibrium
    step = model.transition(*rest, dt)
    loop = LqgLoop(step, schedule(scenario, rest.state), law.system(dt))
    return LqgTheory(law, price(scenario), loop, dt)


def checks(scenario: Scenario, theory: LqgTheory, run: Trajectory) -> list[Check]:
    """Return the comparisons of a run with theory, after the start has settled.

    Raises
    ------
    ValueError
        If the run is too short.
    """
    loop, dt = theory.loop, theory.dt
    p = len(loop.schedule)
    settled = theory.settled
    steps = (len(run.time) - settled) // p * p
    if steps < theory.least_steps:
        raise ValueError(f'run: expected {theory.least_duration:.4g} s or more to judge it')
    part = slice(settled, settled + steps)
    space, rest = scenario.model.state, scenario.model.equilibrium
    x = space.subtract(run.truth[part], rest.state)
    u, P = run.input[part] - rest.input, run.covariance[part]
    e = space.subtract(run.truth[part], run.estimate[part])
    weights, measured, labels = _averages(scenario, theory, x, e, u, P)
    expectations = loop.average(np.stack(weights), steps)
    count = len(labels) + len(scenario.enabled) + 2
    miss = MISS / count
    found = []
    for (name, unit, scale), expected, value in zip(labels, expectations, measured):
        low, high = chi_square_bounds(expected.mean, expected.std**2, miss)
        root = unit not in ('', '1/s')
        numbers = np.array([expected.mean, value, low, high]) * scale
        numbers = np.sqrt(numbers) if root else numbers
        mean, value_, low_, high_ = numbers.tolist()
        found.append(Check(name, unit, mean, value_, low_, high_, low <= value <= high))
    for name in scenario.enabled:
        nis = run.innovations[name].nis
        nis = nis[run.innovations[name].time >= run.time[settled] - 0.5 * dt]
        k = scenario.sensors[name].sensor.output.size
        low, high = chi_square_bounds(1.0, 2.0 / (k * len(nis)), miss)
        value = float(nis.mean()) / k
        found.append(
            Check(f'NIS of {name} / {k}', '', 1.0, value, low, high, low <= value <= high)
        )
    found += _dynamics(loop, run, settled, scenario.model.state, dt, miss)
    return found


def _averages(
    scenario: Scenario, theory: LqgTheory, x: Array, e: Array, u: Array, P: Array
) -> tuple[list[Array], list[float], list[tuple[str, str, float]]]:
    """Return weights, measured means and labels of all quadratic averages of a run."""
    loop, space = theory.loop, scenario.model.state
    n = space.size
    weights, measured, labels = [], [], []
    for index, (name, unit) in enumerate(zip(space.names, space.units)):
        weights.append(loop.error_weight(index))
        measured.append(float(np.mean(e[:, index] ** 2)))
        labels.append((f'RMS error of {name}', unit, 1.0))
    for index, (name, unit) in enumerate(zip(space.names, space.units)):
        weights.append(loop.state_weight(index))
        measured.append(float(np.mean(x[:, index] ** 2)))
        labels.append((f'RMS of {name}', unit, 1.0))
    weights.append(loop.nees_weight)
    measured.append(float(np.mean(nees(e, P))))
    labels.append((f'NEES / {n}', '', 1.0 / n))
    z = np.concatenate((x, u), axis=1)
    weights.append(loop.cost_weight(theory.cost))
    measured.append(float(np.mean(np.einsum('ki,ij,kj->k', z, theory.cost.weight, z))))
    labels.append(('cost J', '1/s', 1.0 / theory.dt))
    return weights, measured, labels


def _dynamics(
    loop: LqgLoop, run: Trajectory, settled: int, space: Space, dt: float, miss: float
) -> list[Check]:
    """Compare the dynamics fitted to a run, and their poles, with exact ones.

    The regulator's are constant from the first step; the filter's gain, and so its poles, settle.
    In real time some steps lack an estimate: only pairs one step, or one period, apart are used.
    """
    p, steps = len(loop.schedule), np.rint(run.time / dt).astype(int)
    x, e = run.truth, space.subtract(run.truth, run.estimate)
    q = _integrals(loop.regulator, run.estimate)
    follows = np.diff(steps) == 1
    regulator = fit(np.hstack((x, q, e))[:-1][follows], x[1:][follows])
    last = np.flatnonzero(steps % p == p - 1)  # the last phase of each period
    last = last[last >= settled]
    follows = np.diff(steps[last]) == p
    estimator = fit(e[last[:-1]][follows], e[last[1:]][follows])
    law, n = loop.regulator_matrix, space.size
    # the input of the integral is known; only the state is fitted
    regulator_poles = eigenvalues(np.vstack((regulator.matrix, law[n:]))[:, : len(law)])
    cases = (
        ('regulator', regulator, law[:n], loop.step.Q, loop.regulator_poles, regulator_poles, dt),
        (
            'estimator', estimator, loop.error_matrix, loop.error_noise,
            eigenvalues(loop.error_matrix), estimator.poles, p * dt,
        ),
    )  # fmt: skip
    found = []
    for name, fitted, exact, noise, poles, fitted_poles, length in cases:
        measured = fitted.distance(exact, noise) / exact.size
        low, high = chi_square_bounds(1.0, 2.0 / exact.size, miss)
        passed = low <= measured <= high
        for pole, nearest in zip(*_paired(poles, fitted_poles)):
            s, near = continuous_poles(np.array([pole, nearest]), length).tolist()
            found.append(Check(f'{name} pole', '1/s', s, near, nan, nan, passed))
        label = f'{name} dynamics, chi2/{exact.size}'
        found.append(Check(label, '', 1.0, measured, low, high, passed))
    return found


def _integrals(regulator: StateSpace, x: Array) -> Array:
    """Return the states (N, r) of a regulator with the input x (N, n).

    The unknown time before the first x is ignored.
    """
    q = np.zeros((len(x), len(regulator.A)))
    for k in range(1, len(x) - 1):
        q[k + 1] = regulator.A @ q[k] + regulator.B @ x[k]
    return q


def _paired(exact: ComplexArray, fitted: ComplexArray) -> tuple[list[complex], list[complex]]:
    """Return the exact poles, slowest first, each with the nearest remaining fitted one."""
    left = list(fitted)
    ordered = sorted(exact, key=lambda z: (-abs(z), z.imag))
    near = []
    for pole in ordered:
        near.append(min(left, key=lambda z: abs(z - pole)))
        left.remove(near[-1])
    return ordered, near
