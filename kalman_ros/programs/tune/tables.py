# SPDX-License-Identifier: Apache-2.0
"""A fit as tables and sentences for the terminal, as JSON, and as lines of a parameter file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich.table import Table

from kalman_ros.analysis.tuning.fit import Fit
from kalman_ros.analysis.tuning.held_out import Judgement
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.analysis.tuning.robust_margins import RobustMargins
from kalman_ros.report.run_tables import plain, plain_table
from kalman_ros.scenario.parameter_text import yaml_value

#: Absolute correlation above which a pair of parameters is mentioned.
_NOTABLE = 0.8


def parameters_table(fit: Fit) -> Table:
    """Return the parameters with their start, value and interval."""
    table = plain_table('', ('start', 'fitted', '95 % interval'), 1)
    for parameter in fit.parameters:
        name = f'{parameter.name} \\[{parameter.unit}]' if parameter.unit else parameter.name
        value = f'{parameter.value:.4g}' if parameter.interval else ''
        interval = parameter.interval or '[yellow]not determined[/]'
        table.add_row(name, f'{parameter.start:.4g}', value, interval)
    return table


def sentences(fit: Fit) -> Iterator[str]:
    """Yield the undetermined parameters, the correlated ones, the likelihoods and convergence."""
    for parameter in fit.parameters:
        if not parameter.determined:
            yield f'{parameter.name}: {parameter.reason}.'
    for i, one in enumerate(fit.parameters):
        for j in range(i):
            r = float(fit.correlation[i, j])
            if abs(r) > _NOTABLE:
                other = fit.parameters[j].name
                yield f'The errors of {other} and {one.name} go together: correlation {r:+.2f}.'
    before, after = fit.aic
    yield (
        f'Log-likelihood of {fit.count} readings: {fit.before:.6g} before, {fit.after:.6g} after; '
        f'AIC {before:.6g} before, {after:.6g} after (lower is better).'
    )
    if fit.interrupted and any(parameter.interval for parameter in fit.parameters):
        yield 'Interrupted before all intervals were computed.'
    elif not fit.converged:
        where = f' on the first {fit.count} readings' if fit.partial else ''
        yield (
            f'Not converged, {fit.stopped}: these values, which have no intervals, are those '
            f'after {fit.steps} steps in all{where}.'
        )


def judgement_table(before: Judgement, after: Judgement) -> Table:
    """Return NIS and whiteness of each sensor before and after the fit."""
    table = plain_table('', ('NIS before', 'after', 'allowed', 'whiteness', 'allowed', ''))
    for name, sensor in after.sensors.items():
        old = before.sensors.get(name)
        low, high = sensor.nis_bounds
        verdict = '[green]ok[/]' if sensor.consistent else '[bold red]FAILS[/]'
        table.add_row(
            name, '' if old is None else f'{old.nis:.3g}', f'{sensor.nis:.3g}',
            f'{low:.3g} to {high:.3g}', f'{sensor.whiteness:+.2f}', f'±{sensor.white_bound:.2f}',
            verdict if sensor.judged else 'too few',
        )  # fmt: skip
    return table


def margins_table(results: Sequence[RobustMargins]) -> Table:
    """Return the margins of each input: those of the fitted model, and the worst."""
    table = plain_table('', ('of the fitted model', 'worst in the intervals'))
    for result in results:
        fitted = result.fitted
        lag = fitted.lag.value * 57.29577951308232
        for name, value, worst, unit in (
            ('upper gain', fitted.upper_gain.value, result.upper_gain, ''),
            ('phase', lag, result.lag, ' deg'),
            ('delay', fitted.delay.value, result.delay, ' s'),
        ):
            table.add_row(f'{name} at {result.input}', f'{value:.3g}{unit}', f'{worst:.3g}{unit}')
    return table


def pasted(fit: Fit, named: NamedParameters) -> dict[str, Any]:
    """Return the parameters to paste, to four digits, without those that did not change.

    The result is empty if the fit determines nothing.
    """
    if not any(parameter.determined for parameter in fit.parameters):
        return {}
    stayed = {
        named.parameter(parameter.name)
        for parameter in fit.parameters
        if parameter.value == parameter.start
    }
    stayed -= {
        named.parameter(parameter.name)
        for parameter in fit.parameters
        if parameter.value != parameter.start
    }
    changes = named.changes(
        {parameter.name: float(f'{parameter.value:.4g}') for parameter in fit.parameters}
    )
    pasted = {name: value for name, value in changes.items() if name not in stayed}
    for name in [name for name in pasted if name.endswith('.covariance_from')]:
        if name.replace('.covariance_from', '.noise') not in pasted:
            del pasted[name]
    return pasted


def beside(fit: Fit) -> Iterator[str]:
    """Yield how to correct fitted biases, which no line of a parameter file subtracts."""
    for fitted in fit.parameters:
        if not fitted.determined or 'bias' not in fitted.name.split('.'):
            continue
        yield (
            f'{fitted.name}: readings are too large by {fitted.value:.4g} {fitted.unit}'.rstrip()
            + f'; correct it where it arises, or let the estimator follow it ({fitted.name}_std).'
        )


def yaml_lines(changes: Mapping[str, Any], fit: Fit, named: NamedParameters) -> list[str]:
    """Return the lines of a parameter file with these parameters."""
    open_ones = {
        named.parameter(parameter.name) for parameter in fit.parameters if not parameter.determined
    }
    return [
        f'{name}: {yaml_value(value)}' + ('   # not determined' if name in open_ones else '')
        for name, value in changes.items()
    ]


def parameter_file(lines: Sequence[str], fit: Fit) -> str:
    """Return the text of a parameter file with these lines; '' without any."""
    if not lines:
        return ''
    mark = [] if fit.converged else [f'# {_unfinished(fit)}']
    return '\n'.join([*mark, '/**:', '  ros__parameters:', *(f'    {line}' for line in lines), ''])


def _unfinished(fit: Fit) -> str:
    """Return why a fit did not converge."""
    return 'interrupted' if fit.interrupted else f'not converged, {fit.stopped}'


def verdict(fit: Fit, held: tuple[Judgement, Judgement] | None) -> tuple[bool, str]:
    """Return whether the fit can be used, and the verdict as text."""
    known = sum(parameter.determined for parameter in fit.parameters)
    count = f'{known} of {len(fit.parameters)} parameters determined'
    if not fit.converged:
        return False, f'[bold red]FAIL, {count}:[/] {_unfinished(fit)}'
    if not known:
        return False, f'[bold red]FAIL, {count}:[/] these data say nothing of them'
    if held is None:
        return True, f'[green]PASS, {count}:[/] nothing was held out to judge the fit by'
    gain = held[1].log_likelihood - held[0].log_likelihood
    change = f'log-likelihood {gain:+.4g} on {held[1].count} readings held out'
    if held[1].consistent and not held[1].judged:
        return True, f'[green]PASS, {count}:[/] {change}, too few of any sensor to judge NIS'
    if held[1].consistent:
        return True, f'[green]PASS, {count}:[/] {change}, NIS and whiteness as they should be'
    failed = [
        n for n, sensor in held[1].sensors.items() if sensor.judged and not sensor.consistent
    ]
    return False, (
        f'[bold red]FAIL, {count}:[/] {change}, but the innovations of '
        f'{", ".join(failed) or "every sensor"} are not as they should be: intervals are too '
        'narrow, and the model lacks something that ./dev doctor may find'
    )


def summary(
    fit: Fit, held: tuple[Judgement, Judgement] | None, changes: Mapping[str, Any],
    worst: Sequence[RobustMargins], notes: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """Return the fit for ``summary.json``."""
    before, after = fit.aic
    return {
        'parameters': [{k: plain(v) for k, v in asdict(p).items()} for p in fit.parameters],
        'correlation': [[plain(v) for v in row] for row in fit.correlation.tolist()],
        'log likelihood': {'before': plain(fit.before), 'after': plain(fit.after)},
        'AIC': {'before': plain(before), 'after': plain(after)},
        'readings': fit.count,
        'converged': fit.converged,
        'interrupted': fit.interrupted,
        'stopped': fit.stopped,
        'held out': None if held is None else {
            when: {
                'log likelihood': plain(judgement.log_likelihood),
                'consistent': judgement.consistent,
                'sensors': {
                    name: {'nis': plain(s.nis), 'nis bounds': list(s.nis_bounds),
                           'whiteness': plain(s.whiteness), 'whiteness bound': s.white_bound}
                    for name, s in judgement.sensors.items()
                },
            }
            for when, judgement in zip(('before', 'after'), held)
        },
        'margins': [
            {'input': loop.input, 'upper gain': plain(loop.upper_gain), 'lag': plain(loop.lag),
             'delay': plain(loop.delay), 'unstable': loop.unstable, 'plants': loop.count}
            for loop in worst
        ],
        'change': dict(changes),
        'notes': list(notes),
    }  # fmt: skip
