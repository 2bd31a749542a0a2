# SPDX-License-Identifier: Apache-2.0
"""Poles can be placed freely; faster ones need more energy.

A cart starts a metre from its set point, each time with faster poles. Its closed loop is fitted
to the plant's ground truth, and the squared force is integrated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.identification import fit
from kalman_ros.control.lqr import Cost
from kalman_ros.linear.placement import sampled_place
from kalman_ros.linear.structure import continuous_poles
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, close
from .cost_to_rest import price
from .stationary import SIGMAS
from .study_run import ON_TRUTH, ran
from .systems import cart, plant

#: The poles are p (-1 +- j), for each of these p in 1/s.
SPEEDS = (1.0, 4.0, 0.5, 2.0)
DT = 0.02
START = np.array([1.0, 0.0])


def study(size: float = 1.0) -> Findings:
    """Run the cart with each set of poles."""
    checks, runs, energies = [], {}, {}
    for speed in sorted(SPEEDS[: max(2, round(len(SPEEDS) * size))]):
        trajectory, speed_checks, energies[speed] = _at(speed)
        checks += speed_checks
        runs[speed] = trajectory
    data = {'energy': {f'{speed:g}': list(pair) for speed, pair in energies.items()}}
    return Findings(checks, lambda path: _draw(runs, energies, path), data)


def _at(speed: float) -> tuple[Trajectory, list[Check], tuple[float, float]]:
    """Return a run with poles at a speed, its checks, and its energy as expected and measured."""
    asked = speed * (-1.0 + 1.0j)
    options = {
        'law': 'placement',
        'regulator_poles': [asked.real] * 2,
        'regulator_frequencies': [asked.imag, -asked.imag],
    }
    # the noise determines the tolerances: its steps are a tenth of a micrometre
    system = cart([1e-12, 1e-12], 0.01, 1.0 / DT, initial_state=START.tolist(), **options)
    trajectory = ran(system, remaps=ON_TRUTH, seconds=12.0 / speed)
    believed = plant(system)
    step = believed.sampled(DT)
    fitted = fit(trajectory.truth[:-1], trajectory.truth[1:])
    upper = int(np.argmax(fitted.poles.imag))
    pole = continuous_poles(fitted.poles, DT)[upper]
    # s = log(z) / DT, so an error of z counts by 1 / (z DT)
    error = fitted.pole_deviations(step.Q)[upper] / abs(fitted.poles[upper]) / DT
    gain = sampled_place(believed.A, believed.B, [asked, asked.conjugate()], DT).gain
    squared = Cost(np.zeros((2, 2)), np.array([[DT]]), np.zeros((2, 1)))
    expected, tolerance = price(step, gain, squared, START, len(trajectory.input))
    measured = float(np.sum(trajectory.input**2) * DT)
    name = f's = {speed:g}'
    checks = [
        close(f'decay, {name}', '1/s', asked.real, pole.real, SIGMAS * error),
        close(f'frequency, {name}', '1/s', asked.imag, pole.imag, SIGMAS * error),
        close(f'energy, {name}', 'm^2/s^3', expected, measured, tolerance),
    ]
    return trajectory, checks, (expected, measured)


def _draw(
    runs: dict[float, Trajectory], energies: dict[float, tuple[float, float]], path: Path
) -> None:
    from kalman_ros.report.style import ESTIMATE, TRUTH, picture, shades

    with picture(path, 1, 2, (8.0, 3.2)) as (_, ((places, energy),)):
        for (speed, run), colour in zip(runs.items(), shades(len(runs))):
            places.plot(run.time, run.truth[:, 0], color=colour, label=f'{speed:g}')
        places.set_xlim(0.0, 8.0)
        places.set_ylabel('x [m]')
        places.set_title('Started at 1 m')
        places.legend(title='p [1/s]', loc='upper right')
        speeds = np.array(list(energies))
        expected, measured = np.array(list(energies.values())).T
        energy.loglog(speeds, expected, color=TRUTH, label='by the Lyapunov equation')
        energy.loglog(speeds, measured, 'o', color=ESTIMATE, label='measured')
        energy.set_xticks(speeds, [f'{speed:g}' for speed in speeds])
        energy.minorticks_off()
        energy.set_xlabel('p [1/s], with poles at p (-1 ± j)')
        energy.set_ylabel('integral of u² [m²/s³]')
        energy.set_title('Energy')
        energy.legend(loc='upper left')
