# SPDX-License-Identifier: Apache-2.0
"""Regulator and estimator do not affect each other's poles.

(a) Other regulators leave the trajectory of the estimation error unchanged, to the last digits.
(b) Other estimators, or the truth itself, connected by a remap alone, leave the regulator's
poles unchanged. (c) The closed loop of plant, observer and feedback has the poles of
A - B K and those of A - L C, together.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis.checks import MISS, Check
from kalman_ros.control.identification import fit
from kalman_ros.core import Signal
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close, largest
from .study_run import StudyRun

#: One axis; both sensors read at every step, so that the observer's gain is one matrix.
_SYSTEM = {'position.rate': 100.0, 'initial_state': [1.0, 0.0]}
#: Noise so small that the poles of a run can be determined to five digits.
_NO_NOISE = {
    'model_parameters.force_noise': 1e-16,
    'position.noise': [1e-8],
    'velocity.noise': [1e-8],
}
#: The source of the controller in (b), as remaps of its estimate.
_SOURCES = {'Kalman': None, 'Luenberger': 'observer/estimate', 'truth': 'ground_truth'}


def study(size: float = 1.0) -> Findings:
    """Run the loop with two regulators, with three estimates, and almost without noise."""
    seconds = 30.0 * max(size, 0.3)
    soft, stiff = (_loop(seconds, {'input_cost': [cost]}) for cost in (1.0, 0.02))
    errors = [run.truth - run.estimate for run in (soft, stiff)]
    checks = [
        close('(a) change of the error', '', 0.0, largest(errors[0] - errors[1]), 1e-9),
        between('(a) change of the state', 'm', 0.05, largest(soft.truth - stiff.truth),
                10.0),
    ]  # fmt: skip
    for name, topic in _SOURCES.items():
        checks += _regulator(name, topic, seconds)
    recorded, predicted = _all_poles()
    for pole, nearest in zip(predicted, recorded):
        distance = abs(pole - nearest) / abs(pole)
        label = f'(c) pole at {pole:.3g}, off by'.replace('+0j', '').replace('-0j', '')
        checks.append(close(label, '', 0.0, distance, 1e-3))
    return Findings(checks, lambda path: _draw(soft, stiff, recorded, predicted, path))


def _loop(seconds: float, overrides: dict[str, Any], **options: Any) -> Trajectory:
    with StudyRun('mass_spring_damper', {**_SYSTEM, **overrides}, seed=1, **options) as run:
        run.advance(seconds)
        return run.trajectory()


def _regulator(name: str, topic: str | None, seconds: float) -> list[Check]:
    """Fit the dynamics of the state under feedback of one kind of estimate."""
    estimate = Signal('', 'nav_msgs/Odometry', ('pose.pose.position.x', 'twist.twist.linear.x'))
    with StudyRun(
        'mass_spring_damper', _SYSTEM, seed=1, also={'observer': 'estimator'},
        only={'observer': {'filter': 'luenberger', 'observer_poles': [-6.0, -7.0]}},
        remaps={
            'observer': {'estimate': 'observer/estimate'},
            'controller': {'estimate': topic} if topic else {},
        },
        record={'observer/estimate': estimate},
    ) as run:  # fmt: skip
        run.advance(seconds)
        loop, scenario = run.trajectory(), run.scenario
        observed = run.recorder['observer/estimate'].values[: len(loop.time)]
    believed = {'Luenberger': observed, 'truth': loop.truth}.get(name, loop.estimate)
    K = feedback(scenario).gain
    step = scenario.model.transition(*scenario.model.equilibrium, 1.0 / scenario.rate)
    x, e = loop.truth, loop.truth - believed
    exact = np.hstack((step.F - step.G @ K, step.G @ K))
    used = 2 if name == 'truth' else 4  # the truth has no error
    fitted = fit(np.hstack((x, e))[:-1, :used], x[1:])
    distance = fitted.distance(exact[:, :used], step.Q) / (2 * used)
    dynamics = Check.ratio(f'(b) {name}: dynamics, misfit^2', distance, 1.0 / used, MISS)
    dt = 1.0 / scenario.rate
    pole = continuous_poles(eigenvalues(exact[:, :2]), dt)[0]
    measured = continuous_poles(fitted.poles, dt)
    nearest = complex(measured[np.argmin(np.abs(measured - pole))])
    unit, unbounded = '1/s', (np.nan, np.nan)
    return [
        Check(f'(b) {name}: pole', unit, complex(pole), nearest, *unbounded, dynamics.passed),
        dynamics,
    ]


def _all_poles() -> tuple[ComplexArray, ComplexArray]:
    """Return the poles of the recorded loop and the predicted poles, in 1/s, both sorted."""
    overrides = {
        **_NO_NOISE, 'filter': 'luenberger', 'observer_poles': [-6.0, -9.0],
        'initial_estimate': [0.3, -0.5],
    }  # fmt: skip
    with StudyRun('mass_spring_damper', {**_SYSTEM, **overrides}) as run:
        run.advance(1.5)
        loop, scenario = run.trajectory(), run.scenario
    z = np.hstack((loop.truth, loop.truth - loop.estimate))
    identified = fit(z[:-1], z[1:])
    observer = build_filter('luenberger', scenario.plan, {'observer_poles': [-6.0, -9.0]})
    assert isinstance(observer, FixedGainObserver)
    step = scenario.model.transition(*scenario.model.equilibrium, 1.0 / scenario.rate)
    error = step.F
    for name, timed in scenario.plan.sensors.items():
        C = timed.sensor.jacobian(loop.truth[0])
        error = (np.eye(2) - observer.gains[name] @ C) @ error
    closed = block_diag(step.F - step.G @ feedback(scenario).gain, error)
    dt = 1.0 / scenario.rate
    exact, fitted = eigenvalues(closed), eigenvalues(identified.matrix)
    return _sorted(continuous_poles(fitted, dt)), _sorted(continuous_poles(exact, dt))


def _sorted(poles: ComplexArray) -> ComplexArray:
    return np.asarray(np.sort_complex(poles), dtype=np.complex128)


def _draw(
    soft: Trajectory,
    stiff: Trajectory,
    recorded: ComplexArray,
    predicted: ComplexArray,
    path: Path,
) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    with figure_with(path, 1, 3, (9.5, 2.9)) as (_, axes):
        for run, colour, label in ((soft, ESTIMATE, 'soft'), (stiff, INPUT, 'stiff')):
            axes[0, 0].plot(run.time, run.truth[:, 0], color=colour, lw=1.0, label=label)
            error = run.truth[:, 0] - run.estimate[:, 0]
            style = '-' if run is soft else ':'
            axes[0, 1].plot(run.time, error, style, color=colour, lw=1.4)
        axes[0, 0].set(title='Two regulators ...', ylabel='x [m]', xlabel='time [s]', xlim=(0, 8))
        axes[0, 0].legend(loc='upper right')
        axes[0, 1].set(title='... one and the same error', ylabel='x - estimate [m]',
                       xlabel='time [s]', xlim=(0, 8))  # fmt: skip
        axes[0, 2].plot(predicted.real, predicted.imag, 'x', color=TRUTH, ms=9, label='predicted')
        axes[0, 2].plot(recorded.real, recorded.imag, 'o', mfc='none', color=ESTIMATE, ms=9,
                        label='in the recorded loop')  # fmt: skip
        axes[0, 2].axvline(0.0, color=READING, lw=0.8)
        axes[0, 2].set(title='Poles of the whole loop', xlabel='real [1/s]', ylabel='imag [1/s]',
                       ylim=(-3.4, 2.2))  # fmt: skip
        axes[0, 2].legend(loc='lower left', fontsize=8)
