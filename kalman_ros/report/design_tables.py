# SPDX-License-Identifier: Apache-2.0
"""A design as text for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import degrees

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.analysis import design_warnings
from kalman_ros.analysis.design_report import DesignReport
from kalman_ros.analysis.design_theory import settling_time
from kalman_ros.analysis.input_loops import Loop
from kalman_ros.analysis.observability import stacked
from kalman_ros.control.margins import DiskMargin
from kalman_ros.control.stability import Mode
from kalman_ros.core import Array, Space, linearize

from .sheet import Sheet


def tables(report: DesignReport, time: str = 's') -> Iterator[tuple[str, Sheet]]:
    """Return the tables of a design with their titles, in reading order; ``time`` is its unit."""
    yield 'Modes', _modes(report, time)
    if report.regulator:
        law = 'u = -K x - K_q q' if report.regulator.feedback.tracked else 'u = -K x'
        yield f'Regulator: {law}', _regulator_gains(report)
    if report.estimator:
        yield 'Estimator: x += L (y - C x)', _estimator_gains(report)
    yield 'Standard deviations', _deviations(report)
    if report.regulator:
        yield 'Margins', _margins(report)


def structure(report: DesignReport) -> str:
    """Return the structure of a design as text: controllable and observable states."""
    seen = report.observability
    along = ' along a simulated path' if report.path else ''
    parts = [f'{seen}{along}{"" if seen.detectable else " (not detectable)"}']
    if report.controllability:
        parts.insert(0, str(report.controllability))
    text = '; '.join(parts)
    return f'{text[0].upper()}{text[1:]}.'


def closing(report: DesignReport, time: str = 's') -> Iterator[str]:
    """Return the performance of the closed loop as text; ``time`` is its unit."""
    if report.closed_loop:
        least = report.scenario.law == 'lqr'
        what = 'The least cost that these sensors allow is' if least else 'Its cost is'
        yield (
            f'The loop settles to a thousandth in {report.closed_loop.settling_time:.3g} '
            f'{time}. '
            f'{what} J = {report.closed_loop.cost:.4g} a second.'
        )
    elif report.estimator:
        seconds = settling_time(report.estimator.modes)
        yield f'The error of the estimate settles to a thousandth in {seconds:.3g} {time}.'


def _modes(report: DesignReport, time: str) -> Sheet:
    groups = {'open loop': report.modes}
    if report.regulator:
        groups['regulator'] = report.regulator.modes
    if report.estimator:
        groups['estimator'] = report.estimator.modes
    names, rows = [], []
    for group, modes in groups.items():
        name = group
        for (pole, *rest), times in Counter(map(_mode, modes)).items():
            names.append(name)
            rows.append((f'{times} x' if times > 1 else '', pole, *rest))
            name = ''
    titles = (
        '', f'pole\n\\[1/{time}]', '', f'time\nconstant\n\\[{time}]',
        f'frequency\n\\[rad/{time}]', 'damping\nratio',
    )  # fmt: skip
    return Sheet(names, list(zip(titles, zip(*rows))))


def _mode(mode: Mode) -> tuple[str, ...]:
    s = mode.pole
    pole = f'{s.real:.3g} ± {s.imag:.3g}j' if s.imag else f'{s.real:.3g}'
    oscillates = (f'{mode.natural_frequency:.3g}', f'{mode.damping_ratio:.3g}')
    constant = f'{mode.time_constant:.3g}' if s.real else ''
    return (pole, mode.fate, constant, *(oscillates if s.imag else ('', '')))


def _regulator_gains(report: DesignReport) -> Sheet:
    """Return K', and K_q' beside the integrated states, with a row per state."""
    columns = {}
    if report.regulator:
        law, n = report.regulator.feedback, report.scenario.model.state.size
        gains = zip(report.scenario.model.input.names, law.gain, law.integral_gain)
        for name, K, K_q in gains:
            columns[f'K of\n{name}'] = K
            if law.tracked:
                columns[f'K_q of\n{name}'] = _spread(K_q, law.tracked, n)
    return _by_state(report, columns)


def _estimator_gains(report: DesignReport) -> Sheet:
    """Return L with a row per state."""
    columns = {}
    for name, L in (report.estimator.gains if report.estimator else {}).items():
        outputs = report.scenario.sensors[name].sensor.output.names
        for output, column in zip(outputs, L.T):
            columns[f'L of {name}\n{output}'] = column
    return _by_state(report, columns)


def _by_state(report: DesignReport, columns: Mapping[str, Array]) -> Sheet:
    names = report.scenario.model.state.names
    return Sheet(names, [(title, _cells(column)) for title, column in columns.items()])


def _cells(column: Array) -> list[str]:
    return [f'{_rounded(column, index):.4g}' for index in range(len(column))]


def matrices(report: DesignReport) -> Iterator[tuple[str, Sheet]]:
    """Return the matrices of a design at its operating point, with the names of their rows."""
    model, dt = report.scenario.model, 1.0 / report.scenario.rate
    x, u = model.state.names, model.input.names
    system, step = linearize(model, *report.point), model.transition(*report.point, dt)
    enabled = report.scenario.enabled
    y = [f'{name}.{o}' for name, source in enabled.items() for o in source.sensor.output.names]
    R = block_diag(*(source.sensor.covariance for source in enabled.values()))
    yield 'A of dx/dt = A x + B u', _matrix(system.A, x, x)
    yield 'B of dx/dt = A x + B u', _matrix(system.B, x, u)
    yield 'C of y = C x', _matrix(stacked(report.scenario, report.point.state), y, x)
    yield "F of x' = F x + G u", _matrix(step.F, x, x)
    yield "G of x' = F x + G u", _matrix(step.G, x, u)
    yield 'Q, process noise of a step', _matrix(step.Q, x, x)
    yield 'R, noise of the readings', _matrix(R, y, y)
    if report.regulator:
        yield 'K of u = -K x', _matrix(report.regulator.feedback.gain, u, x)
    if report.estimator:
        L = np.hstack([report.estimator.gains[name] for name in enabled])
        yield 'L of x += L (y - C x)', _matrix(L, x, y)
        yield 'P, covariance after the readings', _matrix(report.estimator.covariance, x, x)
    elif report.path:
        title = f'P after {report.path.time[-1]:.4g} s of the path'
        yield title, _matrix(report.path.covariance, x, x)


def _matrix(M: Array, rows: Sequence[str], columns: Sequence[str]) -> Sheet:
    return Sheet(rows, [(name, _numbers(column)) for name, column in zip(columns, M.T)])


def _spread(values: Array, places: Sequence[int], n: int) -> Array:
    """Return a vector (n,) with ``values`` at their ``places`` and zeros elsewhere."""
    found = np.zeros(n)
    found[list(places)] = values
    return found


def _rounded(column: Array, index: int) -> float:
    """Return an element, zero if it is rounding relative to the others."""
    value = float(column[index])
    return value if abs(value) > 1e-12 * float(np.max(np.abs(column))) else 0.0


def _deviations(report: DesignReport) -> Sheet:
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
    for window in path.windows if path else ():
        at = int(np.searchsorted(path.time, window.end - 1e-9)) if path else 0
        columns.append((f'on path\n{window.end:.4g} s', _numbers(path.std[at] if path else first)))
    names = [_label(model.state, name) for name in model.state.names]
    if closed:
        blank = [''] * model.input.size
        columns = [(title, [*cells, *blank]) for title, cells in columns]
        columns.append(('in closed loop', _numbers([*closed.state_std, *closed.input_std])))
        names += [_label(model.input, name) for name in model.input.names]
    return Sheet(names, columns) if n else Sheet((), ())


def _numbers(values: Iterable[float]) -> list[str]:
    return [f'{value + 0.0:.4g}' for value in values]  # -0 is 0


def _label(space: Space, name: str) -> str:
    return space.label(name).replace('[', '\\[')


def _margins(report: DesignReport) -> Sheet:
    rows: dict[str, tuple[str, ...]] = {}
    known, estimated = design_warnings.loop_names(report.scenario.law)
    for at in report.regulator.loops if report.regulator else ():
        kept = at.guarantee
        if kept and not report.delay:
            bounds = _range(kept.lower_gain, kept.upper_gain)
            phase = degrees(kept.phase)
            least = f'{kept.distance:.3g}'
            rows[f'{at.input}, LQR guarantees'] = bounds, _turn(phase, phase), '', '', least
        rows[f'{at.input}, {known}'] = _one(at.known)
        if at.estimated is not None:
            rows[f'{at.input}, {estimated}'] = _one(at.estimated)
    joint = report.regulator.together if report.regulator else None
    if joint is not None:
        rows[f'all at once, {known}'] = _all(joint.known)
        if any(at.estimated for at in (report.regulator.loops if report.regulator else ())):
            rows[f'all at once, {estimated}'] = _all(joint.estimated)
    titles = ('gain', 'phase \\[deg]', 'delay \\[s]', 'disk', 'min\n|1 + L|')
    return Sheet(list(rows), list(zip(titles, zip(*rows.values()))))


_UNSTABLE = ('[bold red]unstable[/]', '', '', '', '')


def _all(disk: DiskMargin | None) -> tuple[str, ...]:
    """Return the allowed simultaneous changes of gain and phase of every input."""
    if disk is None:
        return _UNSTABLE
    phase = degrees(disk.phase)
    gains = _range(disk.lower_gain, disk.upper_gain)
    return gains, _turn(phase, phase), '', f'{disk.alpha:.3g}', ''


def _one(loop: Loop) -> tuple[str, ...]:
    if loop.margins is None:
        return _UNSTABLE
    found = loop.margins
    delay = found.delay.value
    return (
        _range(found.lower_gain.value, found.upper_gain.value),
        _turn(degrees(found.lead.value), degrees(found.lag.value)),
        f'{delay:.3g}' if delay < float('inf') else 'any',
        f'{found.disk.alpha:.3g}',
        f'{found.distance.value:.3g}',
    )


def _range(low: float, high: float) -> str:
    return f'{low:.3g} to {high:.3g}' if high < float('inf') else f'from {low:.3g}'


def _turn(lead: float, lag: float) -> str:
    """Return the allowed lead and lag of the phase."""
    ends = (
        'any' if end == float('inf') else f'{sign}{end:.3g}'
        for sign, end in zip('+-', (lead, lag))
    )
    return ', '.join(ends)
