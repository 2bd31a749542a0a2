# SPDX-License-Identifier: Apache-2.0
"""A noisier sensor makes a slower estimator, and a regulator beyond it gains little.

A mass is pushed by noise and its position is measured. First the sensor gets worse while the
nodes run; then, with the worst one, the regulator is made slower and slower. A fast regulator
holds the mass hardly better than one as fast as the estimator, but uses far more input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import MISS, Check, LqgTheory, theory
from kalman_ros.control.identification import fit
from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.harness import Run
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, mean_square
from .loops import average
from .study_run import StudyRun
from .systems import linear

RATE = 50.0
NOISES = (0.02, 0.1, 0.5, 2.5)
WEIGHT = 0.1
WEIGHTS = (1e-5, 1e-3, 0.1, 10.0)


@dataclass(frozen=True)
class Point:
    """Sensor noise and input weight, and the resulting run."""

    noise: float
    weight: float
    run: Trajectory


def study(size: float = 1.0) -> Findings:
    """Run four sensors and three more regulators, 40 s each."""
    seconds = max(20.0, 40.0 * size)
    points = []
    with StudyRun(system(NOISES[0], WEIGHT)) as run:
        for noise in NOISES:
            for node in ('plant', 'estimator'):
                run.set_parameter('reading.noise', [noise], node)
            points.append(_point(run, noise, WEIGHT, seconds))
        for weight in WEIGHTS:
            if weight != WEIGHT:
                run.set_parameter('input_cost', [weight], 'controller')
                points.append(_point(run, NOISES[-1], weight, seconds))
    checks = [check for point in points for check in _checks(point)]
    return Findings(checks, lambda path: _draw(checks, path))


def system(noise: float, weight: float) -> dict[str, Any]:
    """Return a mass of 1 kg pushed by noise, with a sensor and a regulator."""
    return linear(
        {'position': 'm', 'velocity': 'm/s'}, [[0, 1], [0, 0]], [[0], [1]], [0, 1], [[1, 0]],
        [noise], rate=RATE, reading__rate=RATE, state_cost=[1.0, 0.0], input_cost=[weight],
        initial_std=[0.1, 0.1],
    )  # fmt: skip


def _theory(noise: float, weight: float) -> LqgTheory:
    return theory(scenarios.build(system(noise, weight)))


def _point(run: Run, noise: float, weight: float, seconds: float) -> Point:
    """Run until the loop has settled, then for ``seconds``; return the latter part."""
    settled = run.elapsed + _theory(noise, weight).settling_time
    run.advance(settled - run.elapsed + seconds)
    trajectory = run.trajectory()
    part = trajectory.time > settled
    return Point(
        noise, weight,
        Trajectory(
            trajectory.time[part], trajectory.truth[part], trajectory.estimate[part],
            trajectory.covariance[part], trajectory.input[part], trajectory.readings,
            trajectory.innovations,
        ),
    )  # fmt: skip


def _checks(point: Point) -> list[Check]:
    """Compare the estimator's bandwidth and the RMS of its error, position and input."""
    scenario, run = scenarios.build(system(point.noise, point.weight)), point.run
    z = np.hstack((run.truth, run.input))
    x, u = (average(scenario, np.diag(np.eye(3)[index]), len(z)) for index in (0, 2))
    loop = _theory(point.noise, point.weight).loop
    e = loop.average(loop.error_weight(0)[None], len(z))[0]
    cases = (
        ('RMS error', 'm', e, run.truth[:, 0] - run.estimate[:, 0]),
        ('RMS position', 'm', x, run.truth[:, 0]),
        ('RMS input', 'N', u, run.input[:, 0]),
    )
    name = f'{point.noise:g} m, weight {point.weight:g}'
    return [
        _bandwidth(name, point),
        *(
            mean_square(f'{name}: {label}', unit, square, float(np.mean(values**2)), root=True)
            for label, unit, square, values in cases
        ),
    ]


def _bandwidth(name: str, point: Point) -> Check:
    """Compare the poles of the recorded error; they pass or fail with its dynamics."""
    loop = _theory(point.noise, point.weight).loop
    e = point.run.truth - point.run.estimate
    fitted, exact = fit(e[:-1], e[1:]), loop.error_matrix
    low, high = chi_square_bounds(1.0, 2.0 / exact.size, MISS)
    passed = low <= fitted.distance(exact, loop.error_noise) / exact.size <= high
    expected, measured = frequency(eigenvalues(exact)), frequency(fitted.poles)
    return Check(f'{name}: bandwidth', 'rad/s', expected, measured, np.nan, np.nan, passed)


def frequency(poles: ComplexArray) -> float:
    """Return the geometric mean of the magnitudes of sampled poles, in rad/s."""
    return float(np.exp(np.mean(np.log(np.abs(continuous_poles(poles, 1.0 / RATE))))))


def _draw(checks: Sequence[Check], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, allowed, picture

    by_name = {check.name: check for check in checks}
    measured = {name: check.measured.real for name, check in by_name.items()}

    def dots(label: str, noises: Sequence[float], weights: Sequence[float]) -> list[float]:
        names = [f'{n:g} m, weight {w:g}: {label}' for n in noises for w in weights]
        return [measured[name] for name in names]

    def rms(index: int, noise: float, weight: float) -> float:
        scenario = scenarios.build(system(noise, weight))
        return float(np.sqrt(average(scenario, np.diag(np.eye(3)[index]), 1).mean))

    noises: Array = np.asarray(np.geomspace(NOISES[0], NOISES[-1], 25), dtype=float)
    weights: Array = np.asarray(np.geomspace(WEIGHTS[0], WEIGHTS[-1], 25), dtype=float)
    with picture(path, 1, 2, (9.0, 3.4)) as (_, ((sensors, trade),)):
        sensors.plot(
            noises, [frequency(_theory(n, WEIGHT).loop.estimator_poles) for n in noises.tolist()],
            color=ESTIMATE, label='bandwidth of the estimator [rad/s]',
        )  # fmt: skip
        sensors.plot(
            noises, [rms(0, n, WEIGHT) for n in noises.tolist()],
            color=TRUTH, label='RMS of the position [m]',
        )  # fmt: skip
        bars = [by_name[f'{n:g} m, weight {WEIGHT:g}: RMS position'] for n in NOISES]
        allowed(sensors, NOISES, bars, TRUTH)
        sensors.plot(NOISES, dots('bandwidth', NOISES, [WEIGHT]), 'o', color=ESTIMATE, ms=5)
        sensors.plot(NOISES, dots('RMS position', NOISES, [WEIGHT]), 'o', color=TRUTH, ms=5)
        sensors.set_xlabel('noise of the sensor [m] (log)')
        sensors.set_title('A worse sensor (dots: measured; bars: allowed)')
        sensors.set_ylabel('rad/s and m (log)')
        sensors.legend(loc='upper center', bbox_to_anchor=(0.5, -0.18), ncols=2, fontsize=8)
        for noise, colour in ((NOISES[0], ESTIMATE), (NOISES[-1], INPUT)):
            trade.plot(
                [rms(2, noise, w) for w in weights.tolist()],
                [rms(0, noise, w) for w in weights.tolist()],
                color=colour, label=f'noise {noise:g} m',
            )  # fmt: skip
        across = dots('RMS input', NOISES[-1:], WEIGHTS)
        up = dots('RMS position', NOISES[-1:], WEIGHTS)
        allowed(trade, across, [by_name[f'{NOISES[-1]:g} m, weight {w:g}: RMS position']
                                for w in WEIGHTS], INPUT)  # fmt: skip
        trade.plot(across, up, 'o', color=INPUT, ms=5)
        for weight, x, y in zip(WEIGHTS, across, up):
            trade.annotate(
                f'weight {weight:g}', (x, y), (4, 5), textcoords='offset points', fontsize=7
            )
        trade.set_xlabel('RMS of the input [N] (log)')
        trade.set_ylabel('RMS of the position [m] (log)')
        trade.set_title('Fast control needs a good sensor')
        trade.legend(loc='upper center', bbox_to_anchor=(0.5, -0.18), ncols=2, fontsize=8)
        for axis in (sensors, trade):
            axis.set_xscale('log')
            axis.set_yscale('log')
