# SPDX-License-Identifier: Apache-2.0
"""One bearing is a line, two make a place, and a turn of the own ship makes a range.

A ship is tracked from another one by its bearing alone. For 15 minutes both keep their course,
then the own ship turns in pursuit. A second estimator also has the bearing from a buoy 1 km aside.
The standard deviation of the range is compared with the posterior Cramer-Rao bound along the true
path, which does not depend on an estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from std_srvs.srv import SetBool

from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array, Gaussian, Signal
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.scenario import build
from kalman_ros.scenario.estimation import estimation
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .stationary import SIGMAS
from .study_run import StudyRun

DT, TURN, END = 10.0, 900.0, 1800.0
NOISE, FIRST = 0.026, 2000.0
#: Position of the buoy relative to the own ship, in m.
BUOY = (-1000.0, 0.0)
#: Velocity of the own ship before the turn in m/s, for the map.
OWN_VELOCITY = np.array([2.5, 0.0])
FIELDS = ('position[x]', 'position[y]', 'velocity[x]', 'velocity[y]')


def system(sensors: Sequence[str] = ('bearing', 'buoy')) -> dict[str, Any]:
    """Return the parameters; the bearings that are not in ``sensors`` are disabled."""
    options = {
        f'{name}.{key}': value
        for name, place in (('bearing', (0.0, 0.0)), ('buoy', BUOY))
        for key, value in {
            'kind': 'bearing',
            'position': list(place),
            'noise': [NOISE],
            'rate': 1.0 / DT,
            'enabled': name in sensors,
            'topic': f'{name}/reading',
            'type': 'geometry_msgs/PoseWithCovarianceStamped',
            'fields': ['pose.pose.orientation.yaw'],
        }.items()
    }
    return {
        'model': 'bearing_tracker', 'rate': 1.0 / DT, 'sensors': ['bearing', 'buoy'], **options,
        'initial_std': [FIRST, FIRST, 2.0, 2.0], 'filter': 'gaussian_sum', 'enabled': False,
        # a pursuit that first turns across the line of sight
        'state_cost': [1e-9, 1e-11, 0.0, 0.0],
    }  # fmt: skip


@dataclass(frozen=True)
class Track:
    """Estimates (N, 4) and covariances (N, 4, 4) of one estimator, and the bound (N, 4, 4)."""

    estimate: Array
    covariance: Array
    bound: Array


def study(size: float = 1.0) -> Findings:
    """Track the ship for half an hour, at any size."""
    with StudyRun(
        system(), only={'estimator': {'buoy.enabled': False}}, also={'pair': 'estimator'}, seed=2,
        remaps={'pair': {'estimate': 'pair/estimate', 'estimate/covariance': 'pair/covariance'}},
        record={
            'pair/estimate': Signal('', 'sensor_msgs/JointState', FIELDS),
            'pair/covariance': Signal('', 'std_msgs/Float64MultiArray',
                                      tuple(f'data[{k}]' for k in range(16))),
        },
    ) as run:  # fmt: skip
        run.advance(TURN)
        run.call(SetBool, 'controller/enable', SetBool.Request(data=True))
        run.advance(END - TURN)
        trajectory = run.trajectory()
        pair = [run.recorder[f'pair/{name}'].values for name in ('estimate', 'covariance')]
    one, two = (
        posterior_cramer_rao(build(system(names)), trajectory.truth, trajectory.input)
        for names in (['bearing'], ['bearing', 'buoy'])
    )
    n = len(trajectory.time)
    tracks = {
        'one': Track(trajectory.estimate, trajectory.covariance, one),
        'two': Track(pair[0][:n], pair[1][:n].reshape(-1, 4, 4), two),
    }
    return Findings(_checks(trajectory, tracks), lambda path: _draw(trajectory, tracks, path))


def beliefs(run: Trajectory) -> list[Gaussian]:
    """Return the belief of the estimator with one bearing after each step, with its parts.

    Messages have the mean and the covariance alone; the same filter on the same readings and
    inputs has the parts, too.
    """
    built = build(system(['bearing']))
    setup = estimation(built)
    online = OnlineEstimator(setup.filter, setup.sensors, setup.initial, np.zeros(2), setup.policy)
    after = []
    for time, y, u in zip(run.time, run.readings['bearing'].values, run.input):
        stamp = round(time * 1e9)
        online.add_reading('bearing', stamp, y)
        after.append(online.belief)
        online.add_input(stamp, u)
    return after


def range_std(truth: Array, covariance: Array) -> Array:
    """Return the standard deviation (N,) along the line of sight."""
    sight = truth[:, :2] / np.linalg.norm(truth[:, :2], axis=1, keepdims=True)
    return np.asarray(np.sqrt(np.einsum('ki,kij,kj->k', sight, covariance[:, :2, :2], sight)))


def _checks(run: Trajectory, tracks: dict[str, Track]) -> list[Check]:
    """Compare claimed deviations with the bound, and errors with the claimed deviations."""
    truth, one, two = run.truth, tracks['one'], tracks['two']
    distance = np.linalg.norm(truth[:, :2], axis=1)
    before, last = round(TURN / DT), len(truth) - 1
    across = float(np.sqrt(np.trace(one.covariance[0, :2, :2]) - _ranges(run, one)[0] ** 2))
    line = FIRST / float(np.hypot(1.0, FIRST / (distance[0] * NOISE)))
    claimed = {name: _ranges(run, track) for name, track in tracks.items()}
    bounds = {name: range_std(truth, track.bound) for name, track in tracks.items()}
    checks = [
        # the range is unknown by a third, and the width of the line with it
        close('one bearing: sigma across its line', 'm', line, across, 0.35 * line),
        between('one bearing: sigma along / across', '', 10.0, claimed['one'][0] / across, np.inf),
    ]
    for name, step, allowed in (
        ('one', before, 0.35), ('one', last, 0.35), ('two', before, 0.15), ('two', last, 0.15),
    ):  # fmt: skip
        bound, std = float(bounds[name][step]), float(claimed[name][step])
        when = 'before the turn' if step == before else 'in the end'
        checks.append(close(f'{name}, {when}: sigma of range', 'm', bound, std, allowed * bound))
    for name, track in (('one', one), ('two', two)):
        off = np.linalg.norm(track.estimate[:, :2], axis=1) - distance
        worst = float(np.max(np.abs(off[1:]) / _ranges(run, track)[1:]))
        checks.append(between(f'{name}: largest error of range / sigma', '', 0.0, worst, SIGMAS))
    means = np.array([belief.mean for belief in beliefs(run)])
    apart = float(np.abs(means - one.estimate)[:, :2].max())
    gained = float(claimed['one'][before] / claimed['one'][last])
    still = float(claimed['one'][before] / claimed['two'][before])
    return [
        *checks,
        between('its Gaussians: mean of their sum / published', 'm', 0.0, apart, 1e-3),
        between('the turn divides the sigma of range by', '', 5.0, gained, np.inf),
        between('the second bearing, without a turn, by', '', 5.0, still, np.inf),
    ]


def _ranges(run: Trajectory, track: Track) -> Array:
    return range_std(run.truth, track.covariance)


def _own_path(run: Trajectory) -> Array:
    """Return the position (N, 2) of the own ship, from its acceleration."""
    a = run.input[:-1]
    velocity = OWN_VELOCITY + np.vstack((np.zeros(2), np.cumsum(DT * a, axis=0)))
    moved = DT * velocity[:-1] + 0.5 * DT**2 * a
    return np.vstack((np.zeros(2), np.cumsum(moved, axis=0)))


def _draw(run: Trajectory, tracks: dict[str, Track], path: Path) -> None:
    from kalman_ros.report.ellipse import outline
    from kalman_ros.report.mixture_parts import draw_part_ellipses
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    ship, parts = _own_path(run), beliefs(run)
    colours = {'one': ESTIMATE, 'two': INPUT}
    labels = {'one': 'one bearing', 'two': 'two bearings'}
    with figure_with(path, 1, 2, (9.0, 4.8), width_ratios=(0.55, 1.0)) as (_, ((map_, sigma),)):
        map_.plot(*ship.T / 1e3, color=READING, lw=2.0, label='own ship')
        map_.plot(*(ship + run.truth[:, :2]).T / 1e3, color=TRUTH, label='target')
        for step in (1, 45, 90, 115, 130, 150, 180):
            here = ship[step]
            angle = float(run.readings['bearing'].values[step, 0])
            reach = 1.6 * np.hypot(*run.truth[step, :2]) * np.array([np.cos(angle), np.sin(angle)])
            map_.plot(*np.stack((here, here + reach)).T / 1e3, color=READING, lw=0.6)
            label = 'one bearing, its Gaussians' if step == 1 else None
            draw_part_ellipses(map_, parts[step], 1e3, here, label)
            for name, track in tracks.items():
                ellipse = outline(
                    here + track.estimate[step, :2], track.covariance[step, :2, :2], 2.0
                )
                map_.plot(*ellipse.T / 1e3, color=colours[name], lw=1.1,
                          label=f'{labels[name]}, 2 sigma' if step == 1 else None)  # fmt: skip
        map_.set(title='Track and bearings', xlabel='east [km]', ylabel='north [km]')
        map_.set(aspect='equal', xlim=(-1.6, 2.6), ylim=(-0.6, 10.4))
        map_.legend(loc='upper left', fontsize=7)
        for name, track in tracks.items():
            for covariance, style, kind in (
                (track.covariance, '-', 'claimed'), (track.bound, '--', 'bound'),
            ):  # fmt: skip
                values = range_std(run.truth, covariance)
                sigma.semilogy(run.time / 60.0, values, style, color=colours[name], lw=1.3,
                               label=f'{labels[name]}, {kind}')  # fmt: skip
        sigma.axvline(TURN / 60.0, color=READING, lw=0.8)
        sigma.annotate(' turn', (TURN / 60.0, 14.0), fontsize=8)
        sigma.set(title='Uncertainty of the range', ylabel='sigma along the line of sight [m]',
                  xlabel='time [min]')  # fmt: skip
        sigma.legend(loc='lower left', fontsize=7)
