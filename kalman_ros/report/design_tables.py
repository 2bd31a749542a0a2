# SPDX-License-Identifier: Apache-2.0
"""A design for the terminal, and the same numbers for machines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from rich.table import Table

from kalman_ros.control.margins import Margin, Margins
from kalman_ros.control.stability import Mode
from kalman_ros.core import Array, Space
from kalman_ros.simulation import advice
from kalman_ros.simulation.design import DesignReport, settling_time
from kalman_ros.simulation.input_loops import Loop

from .tables import plain, plain_table


def tables(report: DesignReport) -> Iterator[tuple[str, Table]]:
    """Return the tables of a design with their titles, in the order in which they are read."""
    yield 'Modes', _modes(report)
    if report.regulator:
        law = 'u = -K x - K_q q' if report.regulator.feedback.tracked else 'u = -K x'
        yield f'Regulator: {law}', _regulator_gains(report)
    if report.estimator:
        yield 'Estimator: x += L (y - C x)', _estimator_gains(report)
    yield 'Standard deviations', _deviations(report)
    if report.regulator:
        yield 'Margins, one input at a time', _margins(report)


def structure(report: DesignReport) -> str:
    """Return in words what the input moves and what the sensors show."""
    seen = report.observability
    parts = [f'{seen}{"" if seen.detectable else " (not detectable)"}']
    if report.controllability:
        parts.insert(0, str(report.controllability))
    text = '; '.join(parts)
    return f'{text[0].upper()}{text[1:]}.'


def closing(report: DesignReport) -> Iterator[str]:
    """Return in words what the loop does as a whole."""
    if report.closed_loop:
        least = report.scenario.law == 'lqr'
        what = 'The least cost that these sensors allow is' if least else 'Its cost is'
        yield (
            f'The loop settles to a thousandth in {report.closed_loop.settling_time:.3g} s. '
            f'{what} J = {report.closed_loop.cost:.4g} a second.'
        )
    elif report.estimator:
        seconds = settling_time(report.estimator.modes)
        yield f'The error of the estimate settles to a thousandth in {seconds:.3g} s.'


def _modes(report: DesignReport) -> Table:
    columns = (
        'pole\n\\[1/s]',
        '',
        'time constant\n\\[s]',
        'frequency\n\\[rad/s]',
        'damping\nratio',
    )
    table = plain_table('', columns)
    groups = {'open loop': report.modes}
    if report.regulator:
        groups['regulator'] = report.regulator.modes
    if report.estimator:
        groups['estimator'] = report.estimator.modes
    for group, modes in groups.items():
        name = group
        for (pole, *rest), times in Counter(map(_mode, modes)).items():
            table.add_row(name, f'{times} times {pole}' if times > 1 else pole, *rest)
            name = ''
    return table


def _mode(mode: Mode) -> tuple[str, ...]:
    s = mode.pole
    pole = f'{s.real:.3g} ± {s.imag:.3g}j' if s.imag else f'{s.real:.3g}'
    oscillates = (f'{mode.natural_frequency:.3g}', f'{mode.damping_ratio:.3g}')
    constant = f'{mode.time_constant:.3g}' if s.real else ''
    return (pole, mode.fate, constant, *(oscillates if s.imag else ('', '')))


def _regulator_gains(report: DesignReport) -> Table:
    """Return K', and K_q' beside the states that are integrated, with a row a state."""
    columns = {}
    if report.regulator:
        law, n = report.regulator.feedback, report.scenario.model.state.size
        gains = zip(report.scenario.model.input.names, law.gain, law.integral_gain)
        for name, K, K_q in gains:
            columns[f'K of\n{name}'] = K
            if law.tracked:
                columns[f'K_q of\n{name}'] = _spread(K_q, law.tracked, n)
    return _by_state(report, columns)


def _estimator_gains(report: DesignReport) -> Table:
    """Return L with a row a state."""
    columns = {}
    for name, L in (report.estimator.gains if report.estimator else {}).items():
        outputs = report.scenario.sensors[name].sensor.output.names
        for output, column in zip(outputs, L.T):
            columns[f'L of {name}\n{output}'] = column
    return _by_state(report, columns)


def _by_state(report: DesignReport, columns: Mapping[str, Array]) -> Table:
    table = plain_table('', [*columns])
    for index, name in enumerate(report.scenario.model.state.names):
        table.add_row(name, *(f'{_rounded(c, index):.4g}' for c in columns.values()))
    return table


def _spread(values: Array, places: Sequence[int], n: int) -> Array:
    """Return a vector (n,) with ``values`` at their ``places`` and zeros elsewhere."""
    found = np.zeros(n)
    found[list(places)] = values
    return found


def _rounded(column: Array, index: int) -> float:
    """Return an element, zero where it is only rounding beside the others."""
    value = float(column[index])
    return value if abs(value) > 1e-12 * float(np.max(np.abs(column))) else 0.0


def _deviations(report: DesignReport) -> Table:
    closed, first = report.closed_loop, report.scenario.initial_belief.covariance
    reached = 'estimate' if report.estimator else f'after {report.prediction.time[-1]:.3g} s'
    std = report.estimator.std if report.estimator else report.prediction.std[-1]
    columns = ['best sensor', 'first belief', reached, 'in closed loop']
    table = plain_table('', columns if closed else columns[:3])
    model, sensors = report.scenario.model, report.sensor_std
    for index, name in enumerate(model.state.names):
        cells = [
            f'{sensors[name]:.4g}' if name in sensors else '',
            f'{first[index, index] ** 0.5:.4g}',
            f'{std[index]:.4g}',
        ]
        cells += [f'{closed.state_std[index]:.4g}'] if closed else []
        table.add_row(_label(model.state, name), *cells)
    for name, value in zip(model.input.names, closed.input_std if closed else ()):
        table.add_row(_label(model.input, name), '', '', '', f'{value:.4g}')
    return table


def _label(space: Space, name: str) -> str:
    return space.label(name).replace('[', '\\[')


def _margins(report: DesignReport) -> Table:
    columns = ('gain', 'phase \\[deg]', 'delay \\[s]', 'disk')
    table = plain_table('', columns)
    for at in report.regulator.loops if report.regulator else ():
        kept = at.guarantee
        if kept and not report.delay:
            bounds = _range(kept.lower_gain, kept.upper_gain)
            phase = degrees(kept.phase)
            table.add_row(f'{at.input}, LQR guarantees', bounds, _turn(phase, phase), '', '')
        known, estimated = advice.loop_names(report.scenario.law)
        table.add_row(f'{at.input}, {known}', *_bearing(at.known))
        if at.estimated is not None:
            table.add_row(f'{at.input}, {estimated}', *_bearing(at.estimated))
    return table


def _bearing(loop: Loop) -> tuple[str, ...]:
    if loop.margins is None:
        return ('[bold red]unstable[/]', '', '', '')
    found = loop.margins
    delay = found.delay.value
    return (
        _range(found.lower_gain.value, found.upper_gain.value),
        _turn(degrees(found.lead.value), degrees(found.lag.value)),
        f'{delay:.3g}' if delay < float('inf') else 'any',
        f'{found.disk.alpha:.3g}',
    )


def _range(low: float, high: float) -> str:
    return f'{low:.3g} to {high:.3g}' if high < float('inf') else f'from {low:.3g}'


def _turn(lead: float, lag: float) -> str:
    """Return how far the phase may be ahead, and behind."""
    ends = (
        'any' if end == float('inf') else f'{sign}{end:.3g}'
        for sign, end in zip('+-', (lead, lag))
    )
    return ', '.join(ends)


def design_json(
    report: DesignReport, notes: Sequence[str], warnings: Sequence[str]
) -> dict[str, Any]:
    """Return all numbers of a design for ``summary.json``."""
    scenario = report.scenario
    regulator, estimator, closed = report.regulator, report.estimator, report.closed_loop
    reach, seen = report.controllability, report.observability
    return {
        'rate': scenario.rate,
        'delay': report.delay,
        'states': scenario.model.state.names,
        'inputs': scenario.model.input.names,
        'linearised_at': {
            'state': report.point.state.tolist(), 'input': report.point.input.tolist(),
        },
        'modes': [_mode_json(mode) for mode in report.modes],
        'controllability': reach and {
            'controlled': reach.reached, 'not_controlled': reach.unreached,
            'stabilizable': reach.stabilizable,
        },
        'observability': {
            'observed': seen.seen, 'not_observed': seen.unseen, 'detectable': seen.detectable,
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
        'sensor_std': report.sensor_std,
        'closed_loop': closed and {
            'settling_time': plain(closed.settling_time), 'cost': closed.cost,
            'state_std': closed.state_std.tolist(), 'input_std': closed.input_std.tolist(),
        },
        'margins': {
            at.input: {
                'guarantee': at.guarantee and {
                    'gain': [at.guarantee.lower_gain, plain(at.guarantee.upper_gain)],
                    'phase': at.guarantee.phase,
                },
                'state_known': _loop_json(at.known),
                'state_estimated': at.estimated and _loop_json(at.estimated),
            }
            for at in (regulator.loops if regulator else ())
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


def _margins_json(found: Margins) -> dict[str, Any]:
    names = ('lower_gain', 'upper_gain', 'lead', 'lag', 'delay')
    return {
        **{name: _margin_json(getattr(found, name)) for name in names},
        'disk': {'alpha': found.disk.alpha, 'frequency': plain(found.disk.frequency)},
    }


def _margin_json(margin: Margin) -> dict[str, Any]:
    return {'value': plain(margin.value), 'frequency': plain(margin.frequency)}
