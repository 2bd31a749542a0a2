# SPDX-License-Identifier: Apache-2.0
"""The error of an observer falls with the poles of A - L C; with noise it never reaches zero.

A cart drifts, and an observer starts 10 m and 10 m/s away from it. At first its sensor is exact;
after 5 s the sensor becomes noisy. Where the cart goes does not matter to the error.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.identification import fit
from kalman_ros.linear.placement import place_observer
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .stationary import Stationary, estimation_error
from .study_run import StudyRun
from .systems import CART_READING, cart, plant

POLES = (-2.0, -5.0)
DT, NOISE = 0.02, 0.1
#: Noise of the process and of an exact sensor, so small that it does not count.
TINY = 1e-12
START = np.array([10.0, 10.0])
#: Seconds with the exact sensor, and until the noise has filled the observer.
EXACT, FILLED = 5.0, 3.0
CART = cart(
    [0.0, TINY**2], NOISE, 1.0 / DT, enabled=False, filter='luenberger',
    observer_poles=list(POLES), initial_state=[0.0, 1.0], initial_estimate=(-START).tolist(),
)  # fmt: skip


def study(size: float = 1.0) -> Findings:
    """Observe the cart for 5 s without noise, and for 40 s with it."""
    with StudyRun(CART, only={'plant': {'reading.noise': [TINY]}}) as run:
        run.advance(EXACT)
        run.set_parameter('reading.noise', [NOISE])
        run.advance(FILLED + 37.0 * size)
        trajectory = run.trajectory()
    return Findings(_checks(trajectory), lambda path: _draw(trajectory, path))


def _theory() -> Stationary:
    """Return the error of the observer, in which each reading corrects by L DT."""
    system = plant(CART)
    L = place_observer(system.A, CART_READING, POLES).gain * DT
    return estimation_error(system.sampled(DT), CART_READING, np.array([[NOISE**2]]), L)


def _checks(run: Trajectory) -> list[Check]:
    """Compare the recursion without noise with A - L C sampled, and the rest with Lyapunov."""
    error, theory = run.truth - run.estimate, _theory()
    falling, left = error[run.time < EXACT], error[run.time > EXACT + FILLED]
    checks = []
    for asked, expected, pole in zip(
        POLES, _rates(eigenvalues(theory.matrix)), _rates(fit(falling[:-1], falling[1:]).poles)
    ):
        checks.append(close(f'pole of the error for {asked:g}', '1/s', expected, pole, 1e-4))
    share = float(np.linalg.norm(falling[-1]) / np.linalg.norm(falling[0]))
    return [
        *checks,
        between('exact sensor: share left after 5 s', '', 0.0, share, 1e-3),
        theory.rms('noisy sensor: RMS error of x', 'm', 0, left[:, 0]),
        theory.rms('noisy sensor: RMS error of v', 'm/s', 1, left[:, 1]),
    ]


def _rates(poles: ComplexArray) -> list[float]:
    """Return the real parts of sampled poles in 1/s, the slowest first."""
    rates: list[float] = sorted(continuous_poles(poles, DT).real.tolist(), reverse=True)
    return rates


def _draw(run: Trajectory, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    with figure_with(path, 1, 2, (9.0, 3.2)) as (_, ((where, size),)):
        where.plot(run.time, run.truth[:, 0], color=TRUTH, label='truth')
        where.plot(run.time, run.estimate[:, 0], color=ESTIMATE, label='estimate')
        where.set(title='The cart drifts, the estimate finds it', ylabel='x [m]',
                  xlabel='time [s]', xlim=(0.0, EXACT), ylim=(-11.0, 7.0))  # fmt: skip
        where.legend(loc='lower right')
        error = np.abs(run.truth - run.estimate)[:, 0]
        size.semilogy(run.time, error, color=ESTIMATE, label='error of x', lw=1.0)
        slow = _rates(eigenvalues(_theory().matrix))[0]
        anchor = error[round(2.0 / DT)]
        size.semilogy(run.time, anchor * np.exp(slow * (run.time - 2.0)), '--', color=INPUT,
                      lw=1.0, label=f'exp({slow:.3g} t)')  # fmt: skip
        size.axhline(np.sqrt(_theory().covariance[0, 0]), color=TRUTH, lw=1.0, ls=':',
                     label='RMS by Lyapunov')  # fmt: skip
        size.axvline(EXACT, color=READING, lw=0.8)
        size.annotate(' noise on', (EXACT, 3.0), fontsize=8)
        size.set(title='Its error', ylabel='|error of x| [m]', xlabel='time [s]',
                 xlim=(0.0, 12.0), ylim=(1e-5, 30.0))  # fmt: skip
        size.legend(loc='lower left', fontsize=8)
