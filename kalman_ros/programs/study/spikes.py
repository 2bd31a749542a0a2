# SPDX-License-Identifier: Apache-2.0
"""Readings that are far off move an estimate little if the filter doubts them.

A car has a satellite receiver with noise of 3 m and an IMU. The same run is made three times: as
it is, with one fix in 25 that is 15 m off, and with 50 fixes in a row that are, beside three
other receivers. How far the estimates part from those of the first run is what the outliers did,
since all else is the same to the last bit. Without a gate a spike moves the estimate by one to two
metres, and a row of them by five; with gates and an adaptive noise by half a metre and by one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .study_run import StudyRun

RATE, FIXES = 20.0, 5.0
#: Seconds of a run, and those until the first outlier; the row lasts 10 s.
SECONDS, QUIET, ROW = 45.0, 20.0, 10.0
#: Metres that an outlier is off, and seconds between two of them.
OFF, EVERY = 15.0, 5.0
FIX = {
    'kind': 'states', 'measures': ['x', 'y'], 'noise': [3.0, 3.0], 'rate': FIXES,
    'type': 'geometry_msgs/PoseWithCovarianceStamped',
    'fields': ['pose.pose.position.x', 'pose.pose.position.y'],
}  # fmt: skip
OTHERS = ('gnss_b', 'gnss_c', 'gnss_d')
#: Options of each receiver.
FILTERS: Mapping[str, Mapping[str, Any]] = {
    'no gate': {},
    'soft gate': {'soft_gate': 0.95},
    'gates and adaptive noise': {'gate': 0.9999, 'soft_gate': 0.95, 'adapt': True},
}
ROUNDING = 1e-9


def system(receivers: tuple[str, ...], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a car with receivers that have the same options."""
    return {
        'model': 'gnss_imu', 'rate': RATE, 'imu.rate': RATE, 'sensors': [*receivers, 'imu'],
        **{f'{name}.{key}': value for name in receivers for key, value in FIX.items()},
        **{f'{name}.topic': name for name in receivers},
        **{f'{name}.{key}': value for name in receivers for key, value in options.items()},
    }  # fmt: skip


def study(size: float = 1.0) -> Findings:
    """Make each run for 45 s, or for less at a smaller size."""
    seconds = max(QUIET + ROW + 2.0, SECONDS * size)
    row = [(QUIET, QUIET + ROW)]
    single = [(time, time + 1.0 / FIXES) for time in np.arange(QUIET, seconds - 1.0, EVERY)]
    spikes, rows = {}, {}
    for name, options in FILTERS.items():
        alone = system(('gnss',), options)
        spikes[name] = _parted(_run(alone, seconds, ()), _run(alone, seconds, single))
        four = system(('gnss', *OTHERS), options)
        rows[name] = _parted(_run(four, seconds, ()), _run(four, seconds, row))
    checks = [
        close('before the first outlier, parted by', 'm', 0.0, _most(spikes, rows), ROUNDING),
        between('spikes, no gate', 'm', 1.2, _largest(spikes['no gate']), 8.0),
        between('spikes, soft gate', 'm', 0.0, _largest(spikes['soft gate']), 1.0),
        between('row of 50, no gate', 'm', 3.0, _largest(rows['no gate']), 15.0),
    ]
    robust = 'gates and adaptive noise'
    checks.append(between(f'spikes, {robust}', 'm', 0.0, _largest(spikes[robust]), 1.0))
    checks.append(between(f'row of 50, {robust}', 'm', 0.0, _largest(rows[robust]), 2.0))
    return Findings(checks, lambda path: _draw(spikes, rows, path))


def _run(
    parameters: dict[str, Any], seconds: float, off: Sequence[tuple[float, float]]
) -> Trajectory:
    """Run the car; the first receiver is off from the first to the second time of each pair."""
    with StudyRun(parameters, nodes=('estimator', 'plant'), seed=1) as run:
        now = 0.0
        for start, end in off:
            run.advance(start - now)
            run.set_parameter('gnss.bias', [OFF, 0.0])
            run.advance(end - start)
            run.set_parameter('gnss.bias', [0.0, 0.0])
            now = end
        run.advance(seconds - now)
        return run.trajectory()


def _parted(clean: Trajectory, moved: Trajectory) -> tuple[Array, Array]:
    """Return times (N,) and the distances (N,) of the places in two runs, in metres."""
    apart = moved.estimate[:, :2] - clean.estimate[:, :2]
    return clean.time, np.hypot(*apart.T)


def _largest(parted: tuple[Array, Array]) -> float:
    return float(parted[1].max())


def _most(*groups: Mapping[str, tuple[Array, Array]]) -> float:
    """Return the largest distance before the first outlier, over all runs."""
    pairs = [pair for group in groups for pair in group.values()]
    return max(float(distance[time < QUIET - 0.5].max()) for time, distance in pairs)


def _draw(
    spikes: Mapping[str, tuple[Array, Array]], rows: Mapping[str, tuple[Array, Array]], path: Path
) -> None:
    from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, READING, legend_below, picture

    with picture(path, 1, 2, (9.0, 3.6)) as (figure, (axes,)):
        for axis, moved in zip(axes, (spikes, rows)):
            for colour, (name, (time, distance)) in zip((INPUT, READING, ESTIMATE), moved.items()):
                axis.plot(time, distance, color=colour, lw=1.1, label=name)
            axis.set_ylabel('estimate moved by [m]')
        axes[0].set_title(f'One fix in {EVERY:g} s is {OFF:g} m off')
        axes[1].set_title(f'{ROW * FIXES:.0f} fixes in a row, three other receivers')
        axes[1].axvspan(QUIET, QUIET + ROW, color=BOUND, alpha=0.12, lw=0)
        legend_below(figure, axes[0])
