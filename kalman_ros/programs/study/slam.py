# SPDX-License-Identifier: Apache-2.0
"""A robot maps what it measures itself by: closing the loop corrects the whole map at once.

A robot drives a circle with a known heading and sees one of four landmarks at a time, relative to
itself; none is known at first. Position and landmarks are one state, and their covariances
say what one has to do with the other. When the first landmark is seen again, after a lap, the
position and every landmark of the lap become better, although only one was seen. With a known
heading everything is linear, and the filter is consistent.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import MISS, Check
from kalman_ros.core import Array, LinearSystem, Space
from kalman_ros.estimators.consistency import nees
from kalman_ros.linear.periodic import Readings, updated
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .study_run import StudyRun

LANDMARKS, DT, LAP = 4, 0.1, 40.0
RADIUS, TURN = 10.0, 2.0 * np.pi / LAP
#: Density of the robot's velocity noise in m^2/s^3, and noise of a reading in m.
DENSITY, NOISE = 2e-2, 0.3
#: Initial standard deviations: a landmark is unknown, and the robot starts at the origin.
UNKNOWN, ORIGIN = 50.0, 1e-3
PLACES = RADIUS * np.array([[0.7, 1.3], [1.3, 2.0], [0.4, 2.6], [-0.4, 0.9]])
ROUNDING = 1e-9
STATES = ('x', 'y', 'v_x', 'v_y', *(f'{axis}{k}' for k in range(LANDMARKS) for axis in 'xy'))


def robot() -> LinearSystem:
    """Return a robot that turns at a known rate, and landmarks that stay."""
    A = np.zeros((len(STATES), len(STATES)))
    A[:2, 2:4] = np.eye(2)
    A[2:4, 2:4] = TURN * np.array([[0.0, -1.0], [1.0, 0.0]])
    W = np.zeros(len(STATES))
    W[2:4] = DENSITY
    units = ('m', 'm', 'm/s', 'm/s', *('m',) * (2 * LANDMARKS))
    return LinearSystem(A, np.zeros((len(STATES), 0)), W, Space(STATES, units), Space((), ()))


MODEL = robot
#: Measurement matrix of each landmark, whose place is read relative to the robot.
SEEN = [
    np.hstack((-np.eye(2), np.zeros((2, 2 + 2 * k)), np.eye(2), np.zeros((2, 6 - 2 * k))))
    for k in range(LANDMARKS)
]


def system() -> dict[str, Any]:
    """Return the parameters; the plant shows one landmark at a time."""
    names = [f'landmark{k}' for k in range(LANDMARKS)]
    options = {
        f'{name}.{key}': value
        for name, C in zip(names, SEEN)
        for key, value in {
            'kind': 'linear',
            'C': C.ravel().tolist(),
            'noise': [NOISE, NOISE],
            'rate': 1.0,
            'topic': name,
            'type': 'sensor_msgs/JointState',
            'fields': ['position[dx]', 'position[dy]'],
        }.items()
    }
    start = [0.0, 0.0, RADIUS * TURN, 0.0]
    return {
        'model': f'{__name__}:robot', 'rate': 1.0 / DT, 'sensors': names, **options,
        'initial_state': [*start, *PLACES.ravel().tolist()],
        'initial_estimate': [0.0, 0.0, start[2] + 0.08, -0.06, *[0.0] * (2 * LANDMARKS)],
        'initial_std': [ORIGIN, ORIGIN, 0.1, 0.1, *[UNKNOWN] * (2 * LANDMARKS)],
        'state.topic': 'estimate', 'state.type': 'sensor_msgs/JointState',
        'state.fields': [f'position[{name}]' for name in STATES],
    }  # fmt: skip


def study(size: float = 1.0) -> Findings:
    """Drive one lap and a quarter, the least that closes the loop."""
    with StudyRun(system(), nodes=('estimator', 'plant'), seed=4) as run:
        for quarter in range(LANDMARKS + 1):
            for k in range(LANDMARKS):
                run.set_parameter(f'landmark{k}.enabled', k == quarter % LANDMARKS)
            run.advance(LAP / LANDMARKS)
        trajectory = run.trajectory()
    return Findings(_checks(trajectory), lambda path: _draw(trajectory, path))


def position_std(covariance: Array, at: int) -> Array:
    """Return the root of the trace (N,) of the place in two states from ``at`` on."""
    return np.asarray(np.sqrt(covariance[:, at, at] + covariance[:, at + 1, at + 1]))


def _theory(run: Trajectory) -> Array:
    """Return the covariance (N, n, n) by the recursion, with the published readings."""
    step = robot().sampled(DT)
    seen: dict[int, list[Array]] = {}
    for C, series in zip(SEEN, run.readings.values()):
        for time in series.time:
            seen.setdefault(round(time / DT), []).append(C)
    P, R, covariances = np.diag(np.square(system()['initial_std'])), NOISE**2 * np.eye(2), []
    for k in range(len(run.time)):
        P = step.F @ P @ step.F.T + step.Q if k else P
        for C in seen.get(k, []):
            _, P = updated(P, Readings(C, R))
        covariances.append(P)
    return np.array(covariances)


def _checks(run: Trajectory) -> list[Check]:
    """Compare P with the recursion, its change at the end of the lap, and the errors with P."""
    P, n = run.covariance, len(STATES)
    before, after = round((LAP - 0.5) / DT), round((LAP + 3.0) / DT)
    off = float(np.abs(P - _theory(run)).max() / UNKNOWN**2)
    checks = [close('P by the recursion, off by', '', 0.0, off, ROUNDING)]
    for name, at in (('robot', 0), ('landmark 1', 6), ('landmark 2', 8), ('landmark 3', 10)):
        sigma = position_std(P, at)
        share = float(sigma[after] / sigma[before])
        checks.append(between(f'{name}: sigma after the loop / before', '', 0.0, share, 0.95))
    first = float(position_std(P, 4)[after] / position_std(P, 4)[before])
    checks.append(between('landmark 0: the same', '', 0.9, first, 1.0))
    cross = P[before, 8, 10] / np.sqrt(P[before, 8, 8] * P[before, 10, 10])
    checks.append(between('correlation of landmarks 2 and 3', '', 0.7, float(cross), 1.0))
    error = run.truth - run.estimate
    for name, k in (('before the loop', before), ('in the end', -1)):
        value = float(nees(error[k], P[k])) / n
        checks.append(Check.ratio(f'NEES / {n} {name}', value, 2.0 / n, MISS))
    return checks


def _draw(run: Trajectory, path: Path) -> None:
    from kalman_ros.report.ellipse import outline
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with, shades

    before, after = round((LAP - 0.5) / DT), round((LAP + 3.0) / DT)
    with figure_with(path, 1, 2, (9.5, 4.0)) as (_, ((map_, sigma),)):
        map_.plot(*run.truth[:, :2].T, color=TRUTH, lw=1.0, label='robot')
        map_.plot(*run.estimate[:, :2].T, '--', color=ESTIMATE, lw=1.0, label='its estimate')
        map_.plot(*PLACES.T, '+', color=TRUTH, ms=8)
        for k, colour, name in ((before, INPUT, 'before'), (after, ESTIMATE, 'after')):
            for at in (0, 4, 6, 8, 10):
                ellipse = outline(run.estimate[k, at : at + 2],
                                  run.covariance[k, at : at + 2, at : at + 2], 3.0)  # fmt: skip
                label = f'{name} the loop closes, 3 sigma' if at == 0 else None
                map_.plot(*ellipse.T, color=colour, lw=1.2, label=label)
        map_.set(title='Robot and landmarks', xlabel='x [m]', ylabel='y [m]', aspect='equal')
        map_.legend(loc='upper center', bbox_to_anchor=(0.5, -0.14), ncol=2, fontsize=7)
        sigma.semilogy(run.time, position_std(run.covariance, 0), color=TRUTH, label='robot')
        for k, colour in enumerate(shades(LANDMARKS)):
            sigma.semilogy(run.time, position_std(run.covariance, 4 + 2 * k), color=colour,
                           label=f'landmark {k}')  # fmt: skip
        for quarter in range(1, LANDMARKS + 1):
            sigma.axvline(quarter * LAP / LANDMARKS, color=READING, lw=0.6)
        sigma.set(title='Uncertainty; another landmark every 10 s', xlabel='time [s]',
                  ylabel='sigma of the place [m]', ylim=(1e-2, 1e2))  # fmt: skip
        sigma.legend(loc='upper right', fontsize=7)
