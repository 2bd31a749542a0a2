# SPDX-License-Identifier: Apache-2.0
"""A robot on wheels follows paths by the time-varying LQR, closer than by pure pursuit.

A robot with a lag of 0.2 s behind its commands follows a path by its estimate, from wheels,
gyroscope and positions. The motion is planned once: the states along the path, and the commands
that they need. The gains come from the Riccati recursion along it. Pure pursuit steers
towards the point of the same motion that is 0.6 m ahead, at the same speed (R. Coulter,
Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992; 0.6 m is the
default of Nav2). It has no model: it cuts bends, answers late by the lag, and comes back slowly
from where the random changes of speed and turn rate, those of the model's defaults, have moved
it. It runs on the same plant and estimator, in the process of the study.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.cross_track import cross_track
from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.core import Array
from kalman_ros.harness.followed_path import publish_path
from kalman_ros.scenario import build
from kalman_ros.scenario.motions import motion_of, with_law
from kalman_ros.scenario.reference_motions import along_path
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.loop_law import Law
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .study_run import StudyRun

SPEED, ACCELERATION, AHEAD = 1.0, 1.0, 0.6
#: Distance in metres by which a right angle is cut.
ROUNDING = 0.01
#: Seconds that a run continues after the end of a path.
AFTER = 1.0
SYSTEM: dict[str, Any] = {
    'model': 'diff_drive', 'model_parameters.command_time': 0.2,
    'sensors': ['odometry', 'imu', 'position'], 'odometry.noise': [0.01, 0.03],
    'imu.noise': [0.005], 'position.kind': 'states', 'position.measures': ['x', 'y'],
    'position.noise': [0.005, 0.005], 'position.rate': 10.0, 'position.topic': 'position',
    'position.type': 'geometry_msgs/PoseWithCovarianceStamped',
    'position.fields': ['pose.pose.position.x', 'pose.pose.position.y'],
    'initial_std': [0.01, 0.01, 0.02, 0.02, 0.02],
    'state_cost': [400.0, 400.0, 0.1, 1.0, 0.1], 'input_cost': [0.1, 0.1],
}  # fmt: skip


def _wave(s: Array) -> Array:
    return np.column_stack((6.0 * s, 0.8 * np.sin(7.0 * s) + 0.4 * np.sin(12.0 * s) * s))


_TURN = np.linspace(0.0, 2.0 * np.pi, 200)
PATHS: dict[str, Array] = {
    'corner': np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]),
    'figure of eight': np.column_stack((2.0 * np.sin(_TURN), np.sin(2.0 * _TURN))),
    'spline': _wave(np.linspace(0.0, 1.0, 300)),
    'circle': 1.5 * np.column_stack((np.sin(_TURN), 1.0 - np.cos(_TURN))),
    'line': np.array([[0.0, 0.0], [6.0, 0.0]]),
}
#: Largest allowed ratio of the errors, over that many runs.
MOST, RUNS = 0.5, 6


class Followed(NamedTuple):
    """A path, and the runs that follow it: on the nodes, and in this process by both laws."""

    points: Array
    motion: Motion
    nodes: Trajectory
    lqr: list[Trajectory]
    pursuit: list[Trajectory]


def study(size: float = 1.0) -> Findings:
    """Follow five paths on the nodes, and by pure pursuit in this process."""
    names = [*PATHS][: max(1, round(len(PATHS) * size))]
    runs = {name: _follow(PATHS[name]) for name in names}
    return Findings(
        [check for name in names for check in _checks(name, runs[name])],
        lambda path: _draw(runs, path),
    )


def _system(points: Array) -> dict[str, Any]:
    """Return the parameters for a robot at rest at the start of a path."""
    ahead = points[1] - points[0]
    start = [*points[0].tolist(), 0.0, float(np.arctan2(ahead[1], ahead[0])), 0.0]
    return {**SYSTEM, 'initial_state': start, 'initial_estimate': start}


def _follow(points: Array) -> Followed:
    values = _system(points)
    scenario = build(values)
    space = np.column_stack((points, np.zeros(len(points))))
    motion = motion_of(
        scenario, along_path(scenario, space, SPEED, ACCELERATION, rounding=ROUNDING)
    )
    seconds = round(motion.duration + AFTER, 1)
    controls = {'path_speed': SPEED, 'path_acceleration': ACCELERATION, 'path_tolerance': ROUNDING}
    with StudyRun(values, only={'controller': controls}) as run:
        publish_path(run, points)
        run.advance(seconds)
        followed = run.trajectory()
    none = Limits.none(scenario.model.input.size)
    law = Law(scenario, feedback(scenario), none, with_law(scenario, motion))
    lqr, pursuit = (
        [closed_loop.run(scenario, None, seconds, seed, answer=start()) for seed in range(RUNS)]
        for start in _laws(law, motion)
    )
    return Followed(points, motion, followed, lqr, pursuit)


def _laws(law: Law, motion: Motion) -> tuple[Callable[[], Callable[[int, Array], Array]], ...]:
    """Return what starts each of the two laws."""
    return law, lambda: _pure_pursuit(motion)


def _pure_pursuit(motion: Motion) -> Callable[[int, Array], Array]:
    """Return the commands v and omega = 2 v sin(alpha) / L for a time and an estimate."""
    points, speeds, heading = motion.states[:, :2], motion.states[:, 2], motion.states[-1, 3]
    beyond = points[-1] + np.arange(1, 101)[:, np.newaxis] * 0.01 * AHEAD * np.array(
        [np.cos(heading), np.sin(heading)]
    )
    line = np.vstack((points, 2.0 * beyond - points[-1]))
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    nearest, window = 0, 100

    def answer(time: int, x: Array) -> Array:
        nonlocal nearest
        near = points[nearest : nearest + window] - x[:2]
        nearest += int(np.argmin(np.linalg.norm(near, axis=1)))
        to = line[np.searchsorted(s, s[nearest] + AHEAD)] - x[:2]
        alpha = np.arctan2(to[1], to[0]) - x[3]
        v = max(float(speeds[nearest]), 0.05) if nearest < len(points) - 2 else 0.0
        return np.array([v, 2.0 * v * np.sin(alpha) / max(float(np.hypot(*to)), AHEAD)])

    return answer


def _off(followed: Followed, run: Trajectory) -> Array:
    """Return the distances of a run from its path, until the motion ends."""
    return cross_track(followed.points, run.truth[: len(followed.motion.states), :2])


def _rms(followed: Followed, runs: list[Trajectory]) -> float:
    return float(np.sqrt(np.mean([np.nanmean(_off(followed, run) ** 2) for run in runs])))


def _checks(name: str, followed: Followed) -> list[Check]:
    on_nodes, lqr, pursuit = (
        _rms(followed, runs) for runs in ([followed.nodes], followed.lqr, followed.pursuit)
    )
    error = followed.nodes.truth - followed.nodes.estimate
    of_estimate = float(np.sqrt(np.mean(error[:, :2] ** 2)))
    planned = np.abs(followed.nodes.truth[-1, :2] - followed.points[-1]).max()
    return [
        between(f'{name}: cross-track error, LQR', 'm', 0.0, on_nodes, 0.01 + of_estimate),
        between(f'{name}: LQR / pure pursuit, {RUNS} runs', '', 0.0, lqr / pursuit, MOST),
        close(f'{name}: distance from the end', 'm', 0.0, float(planned), 0.03),
    ]


def _draw(runs: dict[str, Followed], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, figure_with

    with figure_with(path, 2, len(runs), (3.2 * len(runs), 5.6)) as (_, (maps, errors)):
        for axis, below, (name, followed) in zip(maps, errors, runs.items()):
            axis.plot(*followed.points.T, color=TRUTH, lw=3.0, alpha=0.25, label='path')
            axis.plot(*followed.pursuit[0].truth[:, :2].T, '--', color=INPUT, lw=1.0,
                      label='pure pursuit')  # fmt: skip
            axis.plot(*followed.nodes.truth[:, :2].T, color=ESTIMATE, lw=1.0, label='LQR')
            axis.set(title=name, xlabel='x [m]', aspect='equal')
            if not np.ptp(followed.points[:, 1]):
                axis.set(ylim=(-1.0, 1.0))
            for run, colour, style in (
                (followed.pursuit[0], INPUT, '--'),
                (followed.nodes, ESTIMATE, '-'),
            ):
                off = 100.0 * _off(followed, run)
                below.plot(run.time[: len(off)], off, style, color=colour, lw=1.0)
            below.set(xlabel='time [s]')
        maps[0].set(ylabel='y [m]')
        errors[0].set(ylabel='distance from the path [cm]')
        maps[0].legend(loc='upper left', fontsize=7)
