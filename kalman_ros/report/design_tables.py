# SPDX-License-Identifier: Apache-2.0
"""Tables and text of a design for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import degrees

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis import design_warnings
from kalman_ros.analysis.checks import is_optimum
from kalman_ros.analysis.design_report import DesignReport
from kalman_ros.analysis.design_theory import settling_time
from kalman_ros.analysis.input_loops import Loop
from kalman_ros.analysis.observability import stacked
from kalman_ros.control.margins import DiskMargin
from kalman_ros.control.stability import Mode
from kalman_ros.core import Array, Space, linearize

from .sheet import Sheet

#: Deviations that differ by less than this share are the same.
_SAME = 0.01


def tables(report: DesignReport, time: str = 's') -> Iterator[tuple[str, Sheet]]:
    """Yield the tables of a design with their titles; ``time`` is the unit of time."""
    yield 'Modes', _mode_sheet(report, time)
    if report.regulator:
        law = 'u = -K x - K_q q' if report.regulator.feedback.tracked else 'u = -K x'
        yield f'Regulator: {law}', _regulator_gains(report)
    if report.estimator:
        yield 'Estimator: x += L (y - C x)', _estimator_gains(report)
    yield 'Standard deviations', _deviation_sheet(report)
    if report.regulator:
        yield 'Margins', _margin_sheet(report)
    if report.unlimited is not None and np.isfinite(report.unlimited).any():
        yield 'Without noise, no limit acts from starts within', _unlimited_sheet(report)


def structure(report: DesignReport) -> str:
    """Return the controllable and the observable states of a design as text."""
    observability = report.observability
    suffix = ' along a simulated path' if report.path else ''
    parts = [f'{observability}{suffix}{"" if observability.detectable else " (not detectable)"}']
    if report.controllability:
        parts.insert(0, str(report.controllability))
    text = '; '.join(parts)
    return f'{text[0].upper()}{text[1:]}.'


def closing(report: DesignReport, time: str = 's') -> Iterator[str]:
    """Yield the performance of the closed loop as text; ``time`` is the unit of time."""
    if report.closed_loop:
        optimal = is_optimum(report.scenario)
        cost = 'The least cost that these sensors allow is' if optimal else 'Its cost is'
        yield (
            f'The loop settles to a thousandth in {report.closed_loop.settling_time:.3g} '
            f'{time}. '
            f'{cost} J = {report.closed_loop.cost:.4g} a second.'
        )
    elif report.estimator:
        seconds = settling_time(report.estimator.modes)
        yield f'The error of the estimate settles to a thousandth in {seconds:.3g} {time}.'


def _mode_sheet(report: DesignReport, time: str) -> Sheet:
    groups = {'open loop': report.modes}
    if report.regulator:
        groups['regulator'] = report.regulator.modes
    if report.estimator:
        groups['estimator'] = report.estimator.modes
    names, rows = [], []
    for group, modes in groups.items():
        name = group
        for (pole, *rest), times in Counter(map(_mode_cells, modes)).items():
            names.append(name)
            rows.append((f'{times} x' if times > 1 else '', pole, *rest))
            name = ''
    titles = (
        '', f'pole\n\\[1/{time}]', '', f'time\nconstant\n\\[{time}]',
        f'frequency\n\\[rad/{time}]', 'damping\nratio',
    )  # fmt: skip
    return Sheet(names, list(zip(titles, zip(*rows))))


def _mode_cells(mode: Mode) -> tuple[str, ...]:
    s = mode.pole
    pole = f'{s.real:.3g} ± {s.imag:.3g}j' if s.imag else f'{s.real:.3g}'
    oscillation = (f'{mode.natural_frequency:.3g}', f'{mode.damping_ratio:.3g}')
    constant = f'{mode.time_constant:.3g}' if s.real else ''
    return (pole, mode.fate, constant, *(oscillation if s.imag else ('', '')))


def _regulator_gains(report: DesignReport) -> Sheet:
    """Return K' with a row for each state, and K_q' in the rows of the integrated states."""
    columns = {}
    if report.regulator:
        law, n = report.regulator.feedback, report.scenario.model.state.size
        gains = zip(report.scenario.model.input.names, law.gain, law.integral_gain)
        for name, K, K_q in gains:
            columns[f'K of\n{name}'] = K
            if law.tracked:
                columns[f'K_q of\n{name}'] = _scatter(K_q, law.tracked, n)
    return _state_sheet(report, columns)


def _estimator_gains(report: DesignReport) -> Sheet:
    """Return L with a row for each state."""
    columns = {}
    for name, L in (report.estimator.gains if report.estimator else {}).items():
        outputs = report.scenario.sensors[name].sensor.output.names
        for output, column in zip(outputs, L.T):
            columns[f'L of {name}\n{output}'] = column
    return _state_sheet(report, columns)


def _state_sheet(report: DesignReport, columns: Mapping[str, Array]) -> Sheet:
    names = report.scenario.model.state.names
    return Sheet(names, [(title, _cells(column)) for title, column in columns.items()])


def _cells(column: Array) -> list[str]:
    return [f'{_round_off(column, index):.4g}' for index in range(len(column))]


def matrices(report: DesignReport) -> Iterator[tuple[str, Sheet]]:
    """Yield the matrices of a design at its operating point, with their titles."""
    model, dt = report.scenario.model, 1.0 / report.scenario.rate
    x, u = model.state.names, model.input.names
    system, step = linearize(model, *report.point), model.transition(*report.point, dt)
    enabled = report.scenario.enabled
    y = [f'{name}.{o}' for name, source in enabled.items() for o in source.sensor.output.names]
    R = block_diag(*(source.sensor.covariance for source in enabled.values()))
    yield 'A of dx/dt = A x + B u', _matrix_sheet(system.A, x, x)
    yield 'B of dx/dt = A x + B u', _matrix_sheet(system.B, x, u)
    yield 'C of y = C x', _matrix_sheet(stacked(report.scenario, report.point.state), y, x)
    yield "F of x' = F x + G u", _matrix_sheet(step.F, x, x)
    yield "G of x' = F x + G u", _matrix_sheet(step.G, x, u)
    yield 'Q, process noise of a step', _matrix_sheet(step.Q, x, x)
    yield 'R, noise of the readings', _matrix_sheet(R, y, y)
    if report.regulator:
        yield 'K of u = -K x', _matrix_sheet(report.regulator.feedback.gain, u, x)
    if report.estimator:
        L = np.hstack([report.estimator.gains[name] for name in enabled])
        yield 'L of x += L (y - C x)', _matrix_sheet(L, x, y)
        yield 'P, covariance after the readings', _matrix_sheet(report.estimator.covariance, x, x)
    elif report.path:
        title = f'P after {report.path.time[-1]:.4g} s of the path'
        yield title, _matrix_sheet(report.path.covariance, x, x)


def _matrix_sheet(M: Array, rows: Sequence[str], columns: Sequence[str]) -> Sheet:
    return Sheet(rows, [(name, _numbers(column)) for name, column in zip(columns, M.T)])


def _scatter(values: Array, places: Sequence[int], n: int) -> Array:
    """Return a vector (n,) with ``values`` at ``places`` and zeros elsewhere."""
    vector = np.zeros(n)
    vector[list(places)] = values
    return vector


def _round_off(column: Array, index: int) -> float:
    """Return an element, or zero if it is a rounding error relative to the others."""
    value = float(column[index])
    return value if abs(value) > 1e-12 * float(np.max(np.abs(column))) else 0.0


def _deviation_sheet(report: DesignReport) -> Sheet:
    model, sensors, closed = report.scenario.model, report.sensor_std, report.closed_loop
    n, path = model.state.size, report.path
    first = np.sqrt(report.scenario.initial_belief.covariance.diagonal())
    columns = [
        ('best sensor', [f'{sensors[x]:.4g}' if x in sensors else '' for x in model.state.names]),
        ('first belief', _numbers(first)),
    ]
    if report.estimator:
        columns.append(('estimate', _numbers(report.estimator.std)))
    elif path is None:
        columns.append(
            (f'after {report.prediction.time[-1]:.3g} s', _numbers(report.prediction.std[-1]))
        )
    columns += _path_columns(report)
    names = [_label(model.state, name) for name in model.state.names]
    if closed:
        blank = [''] * model.input.size
        columns = [(title, [*cells, *blank]) for title, cells in columns]
        columns.append(('in closed loop', _numbers([*closed.state_std, *closed.input_std])))
        names += [_label(model.input, name) for name in model.input.names]
    return Sheet(names, columns) if n else Sheet((), ())


def _path_columns(report: DesignReport) -> list[tuple[str, list[str]]]:
    """Return the deviations along the path; none if they stay those of the estimate."""
    path = report.path
    if path is None:
        return []
    rows = [int(np.searchsorted(path.time, window.end - 1e-9)) for window in path.windows]
    if report.estimator and np.allclose(path.std[rows], report.estimator.std, rtol=_SAME):
        return []
    return [
        (f'on path\n{window.end:.4g} s', _numbers(path.std[row]))
        for window, row in zip(path.windows, rows)
    ]


def _numbers(values: Iterable[float]) -> list[str]:
    return [f'{value + 0.0:.4g}' for value in values]  # -0.0 is written as 0


def _label(space: Space, name: str) -> str:
    return space.label(name).replace('[', '\\[')


def _unlimited_sheet(report: DesignReport) -> Sheet:
    assert report.unlimited is not None
    space, rest = report.scenario.model.state, report.point.state
    below, above = report.unlimited.T
    names = [space.label(name) for name in space.names]
    if np.allclose(below, above, rtol=1e-9, equal_nan=True) and not rest.any():
        return Sheet(names, [('±', [f'{value:.4g}' for value in above.tolist()])])
    ends = [('from', rest - below), ('to', rest + above)]
    return Sheet(
        names, [(title, [f'{value:.4g}' for value in values.tolist()]) for title, values in ends]
    )


def _margin_sheet(report: DesignReport) -> Sheet:
    rows: dict[str, tuple[str, ...]] = {}
    known, estimated = design_warnings.loop_names(report.scenario.law)
    for channel in report.regulator.loops if report.regulator else ():
        guarantee = channel.guarantee
        if guarantee and not report.delay:
            bounds = _format_range(guarantee.lower_gain, guarantee.upper_gain)
            phase = degrees(guarantee.phase)
            distance = f'{guarantee.distance:.3g}'
            rows[f'{channel.input}, LQR guarantees'] = (
                bounds,
                _format_phase(phase, phase),
                '',
                '',
                distance,
            )
        rows[f'{channel.input}, {known}'] = _loop_cells(channel.known)
        if channel.estimated is not None:
            rows[f'{channel.input}, {estimated}'] = _loop_cells(channel.estimated)
    joint = report.regulator.together if report.regulator else None
    if joint is not None:
        rows[f'all at once, {known}'] = _disk_cells(joint.known)
        if any(
            channel.estimated for channel in (report.regulator.loops if report.regulator else ())
        ):
            rows[f'all at once, {estimated}'] = _disk_cells(joint.estimated)
    titles = ('gain', 'lead, lag\n\\[deg]', 'delay \\[s]', 'disk', 'min\n|1 + L|')
    return Sheet(list(rows), list(zip(titles, zip(*rows.values()))))


_UNSTABLE = ('[bold red]unstable[/]', '', '', '', '')


def _disk_cells(disk: DiskMargin | None) -> tuple[str, ...]:
    """Return the allowed simultaneous changes of gain and phase at every input."""
    if disk is None:
        return _UNSTABLE
    phase = degrees(disk.phase)
    gains = _format_range(disk.lower_gain, disk.upper_gain)
    return gains, _format_phase(phase, phase), '', f'{disk.alpha:.3g}', ''


def _loop_cells(loop: Loop) -> tuple[str, ...]:
    if loop.margins is None:
        return _UNSTABLE
    margins = loop.margins
    delay = margins.delay.value
    return (
        _format_range(margins.lower_gain.value, margins.upper_gain.value),
        _format_phase(degrees(margins.lead.value), degrees(margins.lag.value)),
        f'{delay:.3g}' if delay < float('inf') else 'any',
        f'{margins.disk.alpha:.3g}',
        f'{margins.distance.value:.3g}',
    )


def _format_range(low: float, high: float) -> str:
    return f'{low:.3g} to {high:.3g}' if high < float('inf') else f'from {low:.3g}'


def _format_phase(lead: float, lag: float) -> str:
    """Return the allowed lead and lag of the phase."""
    ends = ('any' if end == float('inf') else f'{end:.3g}' for end in (lead, lag))
    return ', '.join(ends)
