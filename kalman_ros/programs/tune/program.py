# SPDX-License-Identifier: Apache-2.0
"""Fit noise, biases, delays and the model's own parameters to a recording."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from kalman_ros import models
from kalman_ros.analysis.tuning.ascent import INTERRUPTED
from kalman_ros.analysis.tuning.fit import Fit, fit, sampled
from kalman_ros.analysis.tuning.held_out import Judgement, judge
from kalman_ros.analysis.tuning.profiles import Profile, profiles
from kalman_ros.analysis.tuning.robust_margins import RobustMargins, robust_margins
from kalman_ros.core import DesignError, Dynamics
from kalman_ros.programs.common_arguments import (
    INTERVAL,
    PRIOR,
    Once,
    add_parameters,
    add_part,
    pairs,
)
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import of_recording, ready
from kalman_ros.scenario import Scenario, build, shipped
from kalman_ros.scenario.parameter_files import from_file, overrides
from kalman_ros.scenario.regulator import steered

from . import tables
from .recorded_likelihood import Recorded, load

#: Number of random plants on the edge of the 95 % region, whose margins are compared.
_PLANTS = 20


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='tune',
        description='Fit parameters of an estimator to a recording by maximum likelihood.',
        epilog='Exit code: 0 if the fit explains the readings held out, 1 if it does not, '
        '2 for a bad argument, 130 if it is interrupted: what was reached is printed and kept.',
    )
    parser.add_argument(
        'bag', type=Path, metavar='BAG',
        help='a folder of rosbag2, one of its files, or a bag of ROS 1',
    )  # fmt: skip
    parser.add_argument(
        '--params-file', type=Path, metavar='FILE', action=Once,
        help="the estimator's parameter file, or the name of a scenario "
        f'(default: {models.DEFAULT})',
    )  # fmt: skip
    parser.add_argument(
        '--fit', nargs='+', default=[], metavar='NAME',
        help='what to fit, as the file calls it, or NAME.bias and NAME.delay of a sensor '
        '(default: all noise)',
    )  # fmt: skip
    parser.add_argument(
        '--bounds', nargs='+', default=[], metavar=''.join(INTERVAL),
        help='the bounds of a parameter',
    )  # fmt: skip
    parser.add_argument(
        '--prior', nargs='+', default=[], metavar=''.join(PRIOR),
        help='what is known of a parameter before',
    )  # fmt: skip
    parser.add_argument(
        '--hold-out', type=float, default=0.3, metavar='SHARE',
        help='the last part, kept to judge the fit by (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/BAG/tune)'
    )
    add_parameters(parser, 'a parameter, over those of the file, such as a start')
    add_part(parser)
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Fit, print and draw; exit with 1 if the fit does not explain the readings held out."""
    options, console = arguments(argv), Console(highlight=False)
    try:
        if not 0.0 <= options.hold_out < 1.0:
            raise ValueError(
                f'--hold-out: expected a share from 0 to below 1, got {options.hold_out:g}'
            )
        changes = overrides(options.parameters)
        bounds = pairs('--bounds', options.bounds, INTERVAL)
        priors = pairs('--prior', options.prior, PRIOR)
        folder = ready(options.out or of_recording(options.bag, 'tune'))
        with _bar(console) as bar:
            task = bar.add_task('reading the recording', total=None)
            recorded = load(
                options.bag, options.params_file, changes, options.fit, bounds, priors,
                options.hold_out, (options.start, options.end),
            )  # fmt: skip

            def report(text: str, share: float) -> None:
                bar.update(task, description=text, total=1.0, completed=share)

            fitted = fit(recorded.likelihood, report)
            results = Results()
            if fitted.complete:
                bar.update(task, description='judging', total=None)
                try:
                    results = _results(recorded, fitted, options, changes)
                except KeyboardInterrupt:
                    fitted = replace(fitted, stopped=INTERRUPTED)
    except (ValueError, OSError) as error:
        refuse('tune', error)

    from kalman_ros.report.style import caption  # matplotlib is slow to load

    from . import pictures

    _show(console, recorded, fitted, results)
    pasted = tables.pasted(fitted, recorded.named)
    lines = tables.yaml_lines(pasted, fitted, recorded.named)
    if lines:
        console.print('\n[bold]For the parameter file[/]')
        console.print('\n'.join(lines), markup=False, soft_wrap=True)
    for sentence in tables.beside(fitted):
        console.print(sentence, markup=False)
    (folder / 'fitted.yaml').write_text(tables.parameter_file(lines, fitted))
    names = ['summary.json', 'fitted.yaml']
    with caption(f'tune, {Path(options.bag).name}'):
        if results.profiles:
            pictures.draw_profiles(results.profiles, folder / 'profiles.png')
            names.append('profiles.png')
        if results.everything is not None and results.everything[1].sensors:
            pictures.draw_nis(*results.everything, _held_from(recorded), folder / 'nis.png')
            names.append('nis.png')
    record = tables.summary(fitted, results.held, pasted, results.margins, recorded.notes)
    (folder / 'summary.json').write_text(json.dumps(record, indent=2) + '\n')
    console.print(f'\nIn {folder}: {", ".join(names)}', style='dim')
    passed, sentence = tables.verdict(fitted, results.held)
    console.print(sentence)
    sys.exit(128 + signal.SIGINT if fitted.interrupted else 0 if passed else 1)


@dataclass(frozen=True)
class Results:
    """Results of a complete fit: judgements before and after it, profiles and margins."""

    everything: tuple[Judgement, Judgement] | None = None
    held: tuple[Judgement, Judgement] | None = None
    profiles: Sequence[Profile] = ()
    margins: Sequence[RobustMargins] = ()
    no_margins: str = ''


def _results(
    recorded: Recorded, fitted: Fit, options: argparse.Namespace, changes: dict[str, Any]
) -> Results:
    starts = {parameter.name: parameter.start for parameter in fitted.parameters}
    after = [None, recorded.likelihood.until] if options.hold_out else [None]
    both = (judge(recorded.likelihood, values, *after) for values in (starts, fitted.values))
    everything, *held = zip(*both)
    shapes = profiles(recorded.likelihood, fitted)
    worst, why = _margins(options.params_file, changes, recorded, fitted)
    return Results(everything, held[0] if held else None, shapes, worst, why)


def _bar(console: Console) -> Progress:
    columns = SpinnerColumn(), TextColumn('{task.description}'), BarColumn(), TimeElapsedColumn()
    return Progress(*columns, console=console, transient=True)


def _held_from(recorded: Recorded) -> float | None:
    """Return the time in seconds at which the part held out begins; None without such a part."""
    likelihood = recorded.likelihood
    if likelihood.until is None:
        return None
    return (likelihood.until - likelihood.observations.span[0]) * 1e-9


def _margins(
    file: Path | None, changes: dict[str, Any], recorded: Recorded, fitted: Fit
) -> tuple[list[RobustMargins], str]:
    """Return the margins of the fitted design, or the reason why there are none."""
    named = recorded.named
    if not named.scenario.model.input.size:
        return [], ''
    path = shipped.file(file or models.DEFAULT)
    values = {'model': models.DEFAULT, **from_file(path, 'estimator', 'controller')}
    try:
        design: Scenario = build({**values, **changes, **named.changes(fitted.values)})
        if steered(design):
            return [], 'No margins: at rest no input moves all of its states; it follows motions.'
        plants: list[Dynamics] = [
            named.candidate(values).model
            for values in sampled(recorded.likelihood, fitted, _PLANTS)
        ]
        return robust_margins(design, plants), ''
    except (ValueError, DesignError) as error:
        return [], f'No design for the fitted model: {error}'


def _show(console: Console, recorded: Recorded, fitted: Fit, results: Results) -> None:
    """Print the fit, the readings held out and the margins."""
    for note in recorded.notes:
        console.print(f'Note: {note}', markup=False)
    console.print(tables.parameters_table(fitted))
    console.print()
    for sentence in tables.sentences(fitted):
        console.print(sentence, markup=False)
    if results.held is not None and results.held[1].sensors:
        console.print('\n[bold]The readings held out[/]')
        console.print(tables.judgement_table(*results.held))
    if results.margins:
        console.print('\n[bold]Margins of the design for the fitted model[/]')
        console.print(tables.margins_table(results.margins))
        for margins in results.margins:
            if margins.unstable:
                console.print(
                    f'[yellow]Warning:[/] {margins.unstable} of {margins.count} plants inside the '
                    f'intervals are unstable in the loop of {margins.input}.'
                )
    elif results.no_margins:
        console.print(results.no_margins, markup=False)
