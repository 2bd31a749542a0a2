# SPDX-License-Identifier: Apache-2.0
"""Comparison of a recorded LQG loop with its theory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, isnan, log, nan

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.identification import fit
from kalman_ros.control.laws import OPTIMAL
from kalman_ros.control.lqr import Cost
from kalman_ros.control.separation import LqgLoop
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array, Space
from kalman_ros.estimators import filter_class
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.linear.periodic import Readings
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.estimation import fixed_gain_observer
from kalman_ros.scenario.regulator import feedback, price
from kalman_ros.simulation.trajectory import Trajectory

from .nis_spread import nis_variances

#: The largest probability that a correct system fails any check of a run.
MISS = 5e-4


@dataclass(frozen=True)
class Check:
    """A measured number with its expectation and bounds.

    A pole has no bounds (NaN): it passes or fails with the dynamics to which it belongs.
    """

    name: str
    unit: str
    expected: complex
    measured: complex
    low: float
    high: float
    passed: bool

    @classmethod
    def within(
        cls, name: str, unit: str, expected: float, measured: float, low: float, high: float
    ) -> Check:
        """Return the check that passes if a number is within its bounds."""
        return cls(name, unit, expected, measured, low, high, bool(low <= measured <= high))

    @classmethod
    def ratio(cls, name: str, measured: float, variance: float, miss: float) -> Check:
        """Return the check of a mean square of 1 with a ``variance``.

        It fails by chance with the probability ``miss``.
        """
        return cls.within(name, '', 1.0, measured, *chi_square_bounds(1.0, variance, miss))

    @property
    def counts(self) -> bool:
        """Whether the check has bounds; a pole passes or fails with its dynamics."""
        return not isnan(self.low)


@dataclass(frozen=True)
class LqgTheory:
    """The control law of a scenario and the theory of its loop."""

    feedback: Feedback
    cost: Cost
    loop: LqgLoop
    dt: float

    @property
    def expected_cost(self) -> float:
        """Expected cost per second."""
        return self.loop.mean_cost(self.cost) / self.dt

    @property
    def settling_time(self) -> float:
        """Time in seconds after which a thousandth of the initial error is left."""
        poles = np.concatenate((self.loop.regulator_poles, self.loop.estimator_poles))
        slowest = float(np.max(np.abs(poles)))
        return log(1e-3) / log(slowest) * self.dt

    @property
    def settled(self) -> int:
        """Step from which a run is evaluated; it begins a period of the schedule."""
        period = len(self.loop.schedule)
        return period * ceil(self.settling_time / self.dt / period)

    @property
    def least_steps(self) -> int:
        """Number of steps after `settled` that a run must have to be checked."""
        return max(200, 20 * len(self.loop.schedule))

    @property
    def least_duration(self) -> float:
        """Duration in seconds of the shortest run that can be checked."""
        return (self.settled + self.least_steps) * self.dt


def schedule(scenario: Scenario, x: Array) -> list[Readings]:
    """Return the readings of each step of a period, with the sensors linearised about x (n,).

    They have the gains of a filter whose gains are fixed.
    """
    plan, fixed = scenario.plan, fixed_gain_observer(scenario)
    phases = []
    for step in range(plan.period):
        due = [plan.sensors[name].sensor for name in plan.due(step)]
        C = np.vstack([np.empty((0, x.size)), *(sensor.jacobian(x) for sensor in due)])
        gain = None if fixed is None else fixed.joint_gain(due)
        phases.append(Readings(C, _block_diagonal(sensor.covariance for sensor in due), gain))
    return phases


def _block_diagonal(covariances: Iterable[Array]) -> Array:
    """Return the block-diagonal matrix (k, k) of independent covariances; k may be 0."""
    return np.asarray(block_diag(np.empty((0, 0)), *covariances), dtype=float)


def theory(scenario: Scenario) -> LqgTheory:
    """Return the control law of a scenario and the steady-state statistics of its loop.

    Raises
    ------
    DesignError
        If the loop cannot be stabilised, or if the sensors do not keep the error bounded.
    """
    law = feedback(scenario)
    model = scenario.model
    dt, rest = 1.0 / scenario.rate, model.equilibrium
    step = model.transition(*rest, dt)
    loop = LqgLoop(step, schedule(scenario, rest.state), law.system(dt))
    return LqgTheory(law, price(scenario), loop, dt)


def is_optimum(scenario: Scenario) -> bool:
    """Return whether no other law and filter have a smaller cost with the same sensors.

    A fixed gain is the best one only where every step has the same readings.
    """
    kind = filter_class(scenario.filter)
    fixed = kind.fixed_gain and scenario.plan.period > 1
    return scenario.law in OPTIMAL and (kind.optimal or kind.mixture) and not fixed


def checks(scenario: Scenario, theory: LqgTheory, run: Trajectory) -> list[Check]:
    """Compare a run with theory, from the step on at which the loop has settled.

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
    window = slice(settled, settled + steps)
    space, rest = scenario.model.state, scenario.model.equilibrium
    x = space.subtract(run.truth[window], rest.state)
    u, P = run.input[window] - rest.input, run.covariance[window]
    e = space.subtract(run.truth[window], run.estimate[window])
    weights, measured, labels = _quadratic_averages(scenario, theory, x, e, u, P)
    expectations = loop.average(np.stack(weights), steps)
    count = len(labels) + len(scenario.enabled) + 2
    miss = MISS / count
    results = []
    for (name, unit, scale), expected, value in zip(labels, expectations, measured):
        low, high = chi_square_bounds(expected.mean, expected.std**2, miss)
        root = unit not in ('', '1/s')
        numbers = np.array([expected.mean, value, low, high]) * scale
        numbers = np.sqrt(numbers) if root else numbers
        results.append(Check.within(name, unit, *numbers.tolist()))
    spread = nis_variances(scenario.plan, fixed_gain_observer(scenario))
    for name in scenario.enabled:
        nis = run.innovations[name].nis
        nis = nis[run.innovations[name].time >= run.time[settled] - 0.5 * dt]
        k = scenario.sensors[name].sensor.output.size
        variance = spread[name] / (k**2 * len(nis))
        results.append(Check.ratio(f'NIS of {name} / {k}', float(nis.mean()) / k, variance, miss))
    results += _check_dynamics(loop, run, settled, scenario.model.state, dt, miss)
    return results


def _quadratic_averages(
    scenario: Scenario, theory: LqgTheory, x: Array, e: Array, u: Array, P: Array
) -> tuple[list[Array], list[float], list[tuple[str, str, float]]]:
    """Return the weights, measured means and labels of all quadratic averages of a run."""
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


def _check_dynamics(
    loop: LqgLoop, run: Trajectory, settled: int, space: Space, dt: float, miss: float
) -> list[Check]:
    """Compare the dynamics that are fitted to a run, and their poles, with theory.

    The regulator is constant from the first step on, whereas the gain and the poles of the filter
    settle first. In real time, some steps have no estimate, so the fit uses only pairs of steps
    that are exactly one step, or one period, apart.
    """
    p, steps = len(loop.schedule), np.rint(run.time / dt).astype(int)
    x, e = run.truth, space.subtract(run.truth, run.estimate)
    q = _regulator_states(loop.regulator, run.estimate)
    follows = np.diff(steps) == 1
    regulator = fit(np.hstack((x, q, e))[:-1][follows], x[1:][follows])
    last = np.flatnonzero(steps % p == p - 1)  # the last step of each period
    last = last[last >= settled]
    follows = np.diff(steps[last]) == p
    estimator = fit(e[last[:-1]][follows], e[last[1:]][follows])
    law, n = loop.regulator_matrix, space.size
    # the integrator rows are known, so only the rows of the state are fitted
    regulator_poles = eigenvalues(np.vstack((regulator.matrix, law[n:]))[:, : len(law)])
    cases = (
        ('regulator', regulator, law[:n], loop.step.Q, loop.regulator_poles, regulator_poles, dt),
        (
            'estimator', estimator, loop.error_matrix, loop.error_noise,
            eigenvalues(loop.error_matrix), estimator.poles, p * dt,
        ),
    )  # fmt: skip
    results = []
    for name, fitted, exact, noise, poles, fitted_poles, length in cases:
        misfit = fitted.distance(exact, noise) / exact.size
        dynamics = Check.ratio(f'{name} dynamics, misfit^2', misfit, 2.0 / exact.size, miss)
        for pole, nearest in zip(*_pair_poles(poles, fitted_poles)):
            s, near = continuous_poles(np.array([pole, nearest]), length).tolist()
            results.append(Check(f'{name} pole', '1/s', s, near, nan, nan, dynamics.passed))
        results.append(dynamics)
    return results


def _regulator_states(regulator: StateSpace, x: Array) -> Array:
    """Return the states (N, r) of a regulator whose input is x (N, n).

    The states start at zero, since the input before the first x is unknown.
    """
    q = np.zeros((len(x), len(regulator.A)))
    for k in range(1, len(x) - 1):
        q[k + 1] = regulator.A @ q[k] + regulator.B @ x[k]
    return q


def _pair_poles(exact: ComplexArray, fitted: ComplexArray) -> tuple[list[complex], list[complex]]:
    """Return the exact poles, slowest first, and the nearest remaining fitted pole of each."""
    remaining = list(fitted)
    ordered = sorted(exact, key=lambda z: (-abs(z), z.imag))
    matches = []
    for pole in ordered:
        matches.append(min(remaining, key=lambda z: abs(z - pole)))
        remaining.remove(matches[-1])
    return ordered, matches
