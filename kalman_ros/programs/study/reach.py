# SPDX-License-Identifier: Apache-2.0
"""An input moves the modes that it reaches, a sensor shows the modes that move it, and no others.

Two equal carts on one spring, twice. Of the first pair both carts get the same force, and the
sensor reads their middle: the distance is neither moved nor seen. Of the second pair one cart gets
the force and one is read, and both modes are reached and seen. One controller and one filter have
both pairs. The energy that it takes to reach a state is x'W^-1 x, with W the Gramian.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array, DesignError, LinearSystem, Transition
from kalman_ros.linear.placement import place
from kalman_ros.linear.structure import uncontrollable_modes
from kalman_ros.scenario import build
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close, largest
from .study_run import ON_TRUTH, ran
from .systems import linear, plant

DT, SECONDS = 0.05, 20.0
#: Stiffness and damping of the spring between the carts, whose mass is 1 kg.
STIFFNESS, DAMPING = 1.0, 0.05
PULL = np.array([-STIFFNESS, -DAMPING, STIFFNESS, DAMPING])
PAIR = np.array([[0.0, 1.0, 0.0, 0.0], PULL, [0.0, 0.0, 0.0, 1.0], -PULL])
FORCES = {'both': np.array([[0.0], [1.0], [0.0], [1.0]]), 'one': np.eye(4)[:, [1]]}
READINGS = {'both': np.array([[0.5, 0.0, 0.5, 0.0]]), 'one': np.eye(4)[[0]]}
#: Row that selects x_1 - x_2 of each pair from the state.
DISTANCE = {'both': np.eye(8)[0] - np.eye(8)[2], 'one': np.eye(8)[4] - np.eye(8)[6]}
#: Target of the Gramian's input, 1 m apart and at rest, and the times in which to reach it.
APART, TIMES = np.array([0.5, 0.0, -0.5, 0.0]), (2.0, 4.0, 10.0)
DENSITY, FIRST = 1e-3, 0.5
SYSTEM = linear(
    {f'{name}{k}': unit for k in range(4) for name, unit in (('x', 'm'), ('v', 'm/s'))},
    block_diag(PAIR, PAIR), block_diag(*FORCES.values()), [0.0, DENSITY] * 4,
    block_diag(*READINGS.values()), [0.05, 0.05], rate=1.0 / DT, reading__rate=1.0 / DT,
    initial_state=[1.0, 0.0, -1.0, 0.0] * 2, initial_std=[FIRST] * 8, state_cost=[5.0, 1.0] * 4,
)  # fmt: skip
ROUNDING = 1e-9


def study(size: float = 1.0) -> Findings:
    """Run both pairs for 20 s, from carts that are 2 m apart; the controller knows the truth."""
    calm = {'plant': {'model_parameters.noise_density': [0.0, 1e-20] * 4}}
    trajectory = ran(SYSTEM, only=calm, remaps=ON_TRUTH, seconds=SECONDS)
    checks = [*_input_checks(trajectory), *_sensor_checks(trajectory), *_energy_checks()]
    return Findings(checks, lambda path: _draw(trajectory, path))


def _step() -> Transition:
    return plant(SYSTEM).sampled(DT)


def _input_checks(run: Trajectory) -> list[Check]:
    """Compare the distance with its free motion, and with the controlled one."""
    step = _step()
    closed = step.F - step.G @ feedback(build(SYSTEM)).gain
    free = _propagate(step.F, run.truth[0], len(run.truth)) @ DISTANCE['both']
    held = _propagate(closed, run.truth[0], len(run.truth)) @ DISTANCE['one']
    stuck = uncontrollable_modes(PAIR, FORCES['both'])
    asked = [-1.0, -1.5, -2.0, -2.5]
    try:
        refused, _ = '', place(PAIR, FORCES['both'], asked)
    except DesignError as error:
        refused = str(error)
    placed = np.sort(place(PAIR, FORCES['one'], asked).poles.real)[::-1]
    return [
        close('force on both: change of the distance', 'm', 0.0,
              largest(run.truth @ DISTANCE['both'] - free), ROUNDING),
        close('force on one: distance by theory, off', 'm', 0.0,
              largest(run.truth @ DISTANCE['one'] - held), 1e-6),
        between('force on one: distance left after 10 s', 'm', 0.0,
                abs(float((run.truth @ DISTANCE['one'])[round(10.0 / DT)])), 0.1),
        close('force on both: modes it does not move', '', 2.0, len(stuck), 0.0),
        close('placement refuses it (1: yes)', '', 1.0, float('no input moves' in refused), 0.0),
        close('force on one: placed poles, off by', '1/s', 0.0, largest(placed - asked), 1e-6),
    ]  # fmt: skip


def _sensor_checks(run: Trajectory) -> list[Check]:
    """Compare the variance of the distance with its variance without a sensor."""
    step = _step()
    alone = _variance_without_sensor(step, len(run.time))
    variances = {name: _variance(run, name) for name in DISTANCE}
    share = float(variances['one'][-1] / alone[-1])
    return [
        close('sensor of the middle: P of the distance, off', 'm^2', 0.0,
              largest(variances['both'] - alone), ROUNDING),
        between('sensor of one: P / P without a sensor', '', 0.0, share, 0.05),
    ]  # fmt: skip


def _variance(run: Trajectory, name: str) -> Array:
    d = DISTANCE[name]
    return np.asarray(np.einsum('i,kij,j->k', d, run.covariance, d))


def _variance_without_sensor(step: Transition, steps: int) -> Array:
    """Return the variance (N,) of the distance with no sensor: P <- F P F' + Q."""
    P, d, variances = FIRST**2 * np.eye(8), DISTANCE['both'], []
    for _ in range(steps):
        variances.append(d @ P @ d)
        P = step.F @ P @ step.F.T + step.Q
    return np.array(variances)


def _propagate(F: Array, x: Array, steps: int) -> Array:
    """Return the states (N, n) of x' = F x."""
    states = [x]
    for _ in range(steps - 1):
        states.append(F @ states[-1])
    return np.array(states)


def reaching(step: Transition, target: Array, steps: int) -> tuple[Array, float]:
    """Return the inputs (N, m) of least energy from rest to ``target`` (n,), and x'W^-1 x.

    W is the sum of F^k G G' F'^k, and u_k = G' F'^(N - 1 - k) W^-1 x (Rugh, Linear System Theory,
    1996, chapter 25).
    """
    columns = [step.G]
    for _ in range(steps - 1):
        columns.append(step.F @ columns[-1])
    reach = np.hstack(columns[::-1])
    solved = np.linalg.solve(reach @ reach.T, target)
    return (reach.T @ solved).reshape(steps, -1), float(target @ solved)


def _one() -> LinearSystem:
    """Return a pair with the force on one cart."""
    states = {'x0': 'm', 'v0': 'm/s', 'x1': 'm', 'v1': 'm/s'}
    return plant(
        linear(states, PAIR, FORCES['one'], np.zeros(4), READINGS['one'], [0.05])
    )  # fmt: skip


def _energy_checks() -> list[Check]:
    """Compare end and energy, x'W^-1 x, of the plant with the inputs of the Gramian."""
    system, checks = _one(), []
    for seconds in TIMES:
        inputs, price = reaching(system.sampled(DT), APART, round(seconds / DT))
        x = np.zeros(4)
        for u in inputs:
            x = system.step(x, u, DT)
        name = f'in {seconds:g} s'
        checks.append(close(f'{name}: misses 1 m apart by', 'm', 0.0, largest(x - APART), 1e-6))
        energy = DT * float(np.sum(inputs**2))
        checks.append(close(f'{name}: energy', 'N^2 s', DT * price, energy, 1e-6 * energy))
    return checks


def _draw(run: Trajectory, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, figure_with

    colours = {'both': INPUT, 'one': ESTIMATE}
    with figure_with(path, 1, 3, (11.0, 3.2)) as (_, ((distance, sigma, energy),)):
        for name, colour in colours.items():
            distance.plot(run.time, run.truth @ DISTANCE[name], color=colour, lw=1.2,
                          label=f'force on {name}')  # fmt: skip
            seen = 'the middle' if name == 'both' else 'one cart'
            sigma.semilogy(run.time, np.sqrt(_variance(run, name)), color=colour,
                           label=f'sensor of {seen}')  # fmt: skip
        alone = np.sqrt(_variance_without_sensor(_step(), len(run.time)))
        sigma.semilogy(run.time, alone, ':', color=TRUTH, lw=2.0, label='without a sensor')
        distance.set(title='Distance of the carts', ylabel='x₁ - x₂ [m]', xlabel='time [s]')
        distance.legend(loc='upper right', fontsize=8)
        sigma.set(title='Its uncertainty', ylabel='sigma [m]', xlabel='time [s]')
        sigma.legend(loc='center right', fontsize=8)
        times = np.geomspace(1.0, 20.0, 40)
        step = _one().sampled(DT)
        prices = [DT * reaching(step, APART, round(t / DT))[1] for t in times]
        energy.loglog(times, prices, color=TRUTH)
        for seconds in TIMES:
            _, price = reaching(step, APART, round(seconds / DT))
            energy.loglog(seconds, DT * price, 'o', color=ESTIMATE)
        energy.set(title='1 m apart, by one force', ylabel='least energy [N² s]',
                   xlabel='in this time [s]')  # fmt: skip
