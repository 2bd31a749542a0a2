# SPDX-License-Identifier: Apache-2.0
"""The results of `design` as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kalman_ros.analysis.design_report import DesignReport
from kalman_ros.analysis.input_loops import Loop
from kalman_ros.analysis.path import Path
from kalman_ros.control.margins import DiskMargin, Margin, Margins
from kalman_ros.control.stability import Mode

from .run_tables import plain


def design_json(
    report: DesignReport, notes: Sequence[str], warnings: Sequence[str]
) -> dict[str, Any]:
    """Return all numbers of a design for ``summary.json``."""
    scenario = report.scenario
    regulator, estimator, closed_loop = report.regulator, report.estimator, report.closed_loop
    controllability, observability = report.controllability, report.observability
    return {
        'rate': scenario.rate,
        'delay': report.delay,
        'states': scenario.model.state.names,
        'inputs': scenario.model.input.names,
        'linearised_at': {
            'state': report.point.state.tolist(), 'input': report.point.input.tolist(),
        },
        'modes': [_mode_json(mode) for mode in report.modes],
        'controllability': controllability and {
            'controlled': controllability.reached,
            'not_controlled': controllability.unreached,
            'stabilizable': controllability.stabilizable,
        },
        'observability': {
            'observed': observability.seen,
            'not_observed': observability.unseen,
            'detectable': observability.detectable,
        },
        'regulator': regulator and {
            'law': scenario.law,
            'gain': regulator.feedback.gain.tolist(),
            'integral_gain': regulator.feedback.integral_gain.tolist(),
            'modes': [_mode_json(mode) for mode in regulator.modes],
        },
        'estimator': estimator and {
            'gains': {name: L.tolist() for name, L in estimator.gains.items()},
            'modes': [_mode_json(mode) for mode in estimator.modes],
            'error_std': estimator.std.tolist(),
        },
        'path': report.path and _path_json(report.path),
        'sensor_std': report.sensor_std,
        'closed_loop': closed_loop and {
            'settling_time': plain(closed_loop.settling_time), 'cost': closed_loop.cost,
            'state_std': closed_loop.state_std.tolist(),
            'input_std': closed_loop.input_std.tolist(),
        },
        'margins': {
            loops.input: {
                'guarantee': loops.guarantee and {
                    'gain': [loops.guarantee.lower_gain, plain(loops.guarantee.upper_gain)],
                    'phase': loops.guarantee.phase,
                },
                'state_known': _loop_json(loops.known),
                'state_estimated': loops.estimated and _loop_json(loops.estimated),
            }
            for loops in (regulator.loops if regulator else ())
        },
        'no_limit_acts_within': None if report.unlimited is None else [
            [plain(below), plain(above)] for below, above in report.unlimited.tolist()
        ],
        'margins_of_all_inputs': regulator and regulator.together and {
            'state_known': _disk_json(regulator.together.known),
            'state_estimated': _disk_json(regulator.together.estimated),
        },
        'notes': notes,
        'warnings': warnings,
    }  # fmt: skip


def _mode_json(mode: Mode) -> dict[str, Any]:
    return {
        'pole': plain(mode.pole), 'fate': mode.fate,
        'time_constant': plain(mode.time_constant), 'damping_ratio': plain(mode.damping_ratio),
    }  # fmt: skip


def _loop_json(loop: Loop) -> dict[str, Any]:
    return {
        'margins': loop.margins and _margins_json(loop.margins),
        'delay_margin_without_delay': plain(loop.prompt.delay.value),
    }


def _margins_json(margins: Margins) -> dict[str, Any]:
    names = ('lower_gain', 'upper_gain', 'lead', 'lag', 'delay', 'distance')
    return {
        **{name: _margin_json(getattr(margins, name)) for name in names},
        'disk': _disk_json(margins.disk),
    }


def _disk_json(disk: DiskMargin | None) -> dict[str, Any] | None:
    return {'alpha': disk.alpha, 'frequency': plain(disk.frequency)} if disk else None


def _path_json(path: Path) -> dict[str, Any]:
    return {
        'duration': float(path.time[-1]),
        'windows': [
            {
                'start': float(window.start), 'end': float(window.end),
                'determined': window.observed, 'std': [plain(s) for s in window.std.tolist()],
            }
            for window in path.windows
        ],
        'error_std_at_the_end': path.std[-1].tolist(),
        'growing': path.growing,
    }  # fmt: skip


def _margin_json(margin: Margin) -> dict[str, Any]:
    return {'value': plain(margin.value), 'frequency': plain(margin.frequency)}
