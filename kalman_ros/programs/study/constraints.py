# SPDX-License-Identifier: Apache-2.0
"""A regulator that predicts its limits keeps the pole up where one that is cut off loses it.

A cart begins 0.8 m from the middle of a track that ends at 1 m, with a motor of at most 10 N. The
least-cost regulator asks for more than the motor has. Cut off at the limit, it leans the pole
further than 10 N can bring back. With ``law: mpc`` the same weights are minimised within the
limits: the cart goes slower, stays on the track, and the pole leans no further than 0.4 rad,
where the linear model is good. Where no limit acts, both are the same to the last bit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.limiter import limits_of
from kalman_ros.scenario import build
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.loop_law import Law
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, between, close
from .study_run import ran

#: Ends of the track in metres, the largest lean in rad, and the largest force in N.
TRACK, LEAN, FORCE = 1.0, 0.4, 10.0
#: Seconds of a run, and the number of runs in this process.
SECONDS, RUNS = 5.0, 100
#: A pole that leans further has fallen.
FALLEN = 0.5 * np.pi
#: Excess over the limit of the lean that noise and its price leave, in rad.
SLACK = 0.05
_BEGINS = [0.8, 0.0, 0.0, 0.0]
SYSTEM: dict[str, Any] = {
    'model': 'cart_pole',
    'initial_state': _BEGINS,
    'initial_estimate': _BEGINS,
}
LAWS: dict[str, dict[str, Any]] = {
    'cut off': {'law': 'lqr'},
    'predicted': {
        'law': 'mpc',
        'state_limit.x': [-TRACK, TRACK],
        'state_limit.theta': [-LEAN, LEAN],
    },
}


def study(size: float = 1.0) -> Findings:
    """Run both laws on the nodes with a weak motor and with a strong one, and on many seeds."""
    weak = {name: _run(law, FORCE) for name, law in LAWS.items()}
    runs = max(3, round(RUNS * size))
    checks = [
        *_kept(weak['predicted']),
        between('cut off: largest lean', 'rad', FALLEN, _largest(weak['cut off'], 2), np.inf),
        close('no limit acts: difference of the forces', 'N', 0.0, _difference(), 0.0),
        *_many(runs),
    ]
    return Findings(checks, lambda path: _draw(weak, path))


def _run(law: dict[str, Any], force: float) -> Trajectory:
    controls = {**law, 'input_limit': [force]}
    return ran({**SYSTEM, **law}, only={'controller': controls}, seconds=SECONDS)


def _largest(run: Trajectory, index: int) -> float:
    return float(np.abs(run.truth[:, index]).max())


def _kept(run: Trajectory) -> list[Check]:
    """Check that a run has kept its limits."""
    upright = float(np.abs(run.truth[-1, [0, 2]]).max())
    return [
        between('predicted: largest distance', 'm', 0.0, _largest(run, 0), TRACK),
        between('predicted: largest lean', 'rad', 0.0, _largest(run, 2), LEAN + SLACK),
        between('predicted: largest force', 'N', 0.0, float(np.abs(run.input).max()), FORCE),
        between('predicted: x and theta at the end', '', 0.0, upright, 0.1),
    ]


def _difference() -> float:
    """Return the largest difference of the forces of both laws where the motor is strong."""
    strong = [_run({'law': law['law']}, 1e6) for law in LAWS.values()]
    return float(np.abs(strong[0].input - strong[1].input).max())


def _many(runs: int) -> list[Check]:
    """Count in this process how often the pole falls, and look at the worst run within limits."""
    falls, worst = {}, 0.0
    for name, options in LAWS.items():
        scenario = build({**SYSTEM, **options})
        bounds = limits_of(scenario.model.input.size, {'input_limit': FORCE})
        law = Law(scenario, feedback(scenario), bounds, None)
        states = [
            closed_loop.run(scenario, None, SECONDS, seed, answer=law()).truth
            for seed in range(runs)
        ]
        leans = np.array([np.abs(truth[:, 2]).max() for truth in states])
        falls[name] = float(np.mean(leans > FALLEN))
        worst = max(np.abs(truth[:, 0]).max() for truth in states)
    return [
        between(f'{runs} runs, cut off: share that falls', '', 0.9, falls['cut off'], 1.0),
        close(f'{runs} runs, predicted: share that falls', '', 0.0, falls['predicted'], 0.0),
        between(f'{runs} runs, predicted: largest distance', 'm', 0.0, float(worst), TRACK),
    ]


def _draw(runs: dict[str, Trajectory], path: Path) -> None:
    from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, figure_with

    with figure_with(path, 3, 1, (8.0, 6.4)) as (_, grid):
        axes = np.ravel(grid)
        for name, colour, style in (('cut off', INPUT, '--'), ('predicted', ESTIMATE, '-')):
            run = runs[name]
            fallen = np.abs(run.truth[:, 2]) > FALLEN
            end = int(np.argmax(fallen)) if fallen.any() else len(run.time)
            for axis, values in zip(axes, (run.truth[:, 0], run.truth[:, 2], run.input[:, 0])):
                shown = values[:end]
                axis.plot(run.time[: len(shown)], shown, style, color=colour, lw=1.2, label=name)
        titles = ('cart [m]', TRACK), ('lean of the pole [rad]', LEAN), ('force [N]', FORCE)
        for axis, (label, limit) in zip(axes, titles):
            axis.set(ylabel=label, ylim=(-1.8 * limit, 1.8 * limit))
            for side in (-limit, limit):
                axis.axhline(side, color=BOUND, lw=1.0, ls=':')
        axes[0].set(title='The same weights: limits cut off, and limits predicted')
        axes[-1].set(xlabel='time [s]')
        axes[0].legend(loc='lower right')
