# SPDX-License-Identifier: Apache-2.0
"""The sampled loops of a scenario with one sensor, broken at the input of the plant.

In lockstep the input computed from the readings of a step acts from that step to the next, so
the loop has no delay.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis.checks import schedule
from kalman_ros.control.compensator import current_compensator
from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.lqe import LqeDesign, dlqe
from kalman_ros.control.separation import Expectation
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array, LinearSystem, linearize
from kalman_ros.linear.periodic import Readings
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import feedback

from .stationary import Stationary


def lqr_loop(scenario: Scenario, delay: float = 0.0) -> StateSpace:
    """Return the loop of the regulator with a known state."""
    return sampled_plant(_system(scenario), feedback(scenario).gain, 1.0 / scenario.rate, delay)


def lqg_loop(
    scenario: Scenario, delay: float = 0.0, believed: Scenario | None = None
) -> StateSpace:
    """Return the loop of regulator and estimator, which may assume other noise."""
    C = _readings(scenario).C
    late = sampled_plant(_system(scenario), C, 1.0 / scenario.rate, delay)
    return controller(scenario, believed) @ late


def _readings(scenario: Scenario) -> Readings:
    """Return the measurement of a scenario's only sensor at every step."""
    return schedule(scenario, scenario.model.equilibrium.state)[0]


def controller(scenario: Scenario, believed: Scenario | None = None) -> StateSpace:
    """Return the system from the readings to the input: estimator and regulator."""
    plant = sampled_plant(_system(scenario), _readings(scenario).C, 1.0 / scenario.rate)
    return current_compensator(
        plant, feedback(scenario).system(1.0 / scenario.rate), estimator(believed or scenario)
    )


def estimator(scenario: Scenario) -> LqeDesign:
    """Return the steady-state Kalman filter of a scenario."""
    step, readings = _system(scenario).sampled(1.0 / scenario.rate), _readings(scenario)
    return dlqe(step.F, readings.C, step.Q, readings.R)


def growth(loop: StateSpace) -> float:
    """Return the rate (1/s) at which the slowest mode of a closed sampled loop grows."""
    return float(np.log(np.max(np.abs(loop.closed().poles))) / (loop.dt or 1.0))


def average(
    scenario: Scenario, weight: Array, steps: int, control: StateSpace | None = None
) -> Expectation:
    """Return the expected mean of z'M z, z = (x, u), over steps in steady state.

    Unlike `LqgLoop.average` it applies to any controller, such as one that assumes other noise.
    The noise of the reading counts as a state, since it acts directly on the input.

    Parameters
    ----------
    scenario
        The real system, with one sensor.
    weight
        M (n + m, n + m).
    steps
        Number of steps in the average.
    control
        From the readings to -u; by default the LQG controller of the scenario.
    """
    step, readings = _system(scenario).sampled(1.0 / scenario.rate), _readings(scenario)
    F, G, C = step.F, step.G, readings.C
    H = controller(scenario) if control is None else control
    n, h, k = len(F), len(H.A), len(C)
    outputs = np.block([[np.eye(n), np.zeros((n, h + k))], [-H.D @ C, -H.C, -H.D]])
    u = outputs[n:]
    M = np.vstack((
        np.hstack((F, np.zeros((n, h + k)))) + G @ u,
        np.hstack((H.B @ C, H.A, H.B)),
        np.zeros((k, n + h + k)),
    ))  # fmt: skip
    noise = block_diag(step.Q, np.zeros((h, h)), readings.R)
    return Stationary(M, noise).average(outputs.T @ weight @ outputs, steps)


def _system(scenario: Scenario) -> LinearSystem:
    rest: tuple[Array, Array] = scenario.model.equilibrium
    return linearize(scenario.model, *rest)
