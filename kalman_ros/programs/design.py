# SPDX-License-Identifier: Apache-2.0
"""Theory of a scenario before anything runs: modes, gains, errors, margins."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from kalman_ros import models, scenario
from kalman_ros.analysis import design_theory, design_warnings
from kalman_ros.analysis import path as paths
from kalman_ros.analysis.worst_case import WorstCases, named_plants, worst_cases
from kalman_ros.control.limiter import Limits
from kalman_ros.programs.common_arguments import INTERVAL, add_parameters, add_scenario, pairs
from kalman_ros.programs.known_parameters import refuse_unknown_parameters
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.parameter_files import from_file, overrides
from kalman_ros.scenario.regulator import actuators

from .results import ready


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='design',
        description='Print and draw the theory of a scenario. No node is started.',
        epilog='Exit code: 0 if a design exists, with or without warnings, 2 otherwise.',
    )
    where = parser.add_mutually_exclusive_group()
    add_scenario(where)
    where.add_argument(
        '--params-file', type=Path, metavar='FILE', help='the same as a parameter file'
    )
    parser.add_argument(
        '--delay', type=float, metavar='S',
        help='seconds from a reading to the resulting input; by default margins are of a '
        'loop without delay, and warnings expect one sample',
    )  # fmt: skip
    parser.add_argument(
        '--duration', type=float, metavar='S',
        help='seconds of the simulated path along which a scenario is judged that is not linear '
        '(default: those of its demo, if that is not too many steps)',
    )  # fmt: skip
    parser.add_argument(
        '--within', action='append', default=[], metavar='NAME=LOW..HIGH',
        help='bound cost and margins while a parameter of the plant is anywhere in an interval; '
        'up to three times; actuator_gain is a factor of all inputs',
    )  # fmt: skip
    parser.add_argument(
        '--matrices', action='store_true', help='print A, B, C, F, G, Q, R, K, L and P, too'
    )
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='for the results (default: out/SCENARIO/design)'
    )
    add_parameters(parser, 'a parameter, over those of the file')
    return parser.parse_args(argv)


def believed(path: Path, changes: dict[str, Any]) -> Scenario:
    """Return the scenario of estimator and controller from a parameter file.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """
    values = {**from_file(path, 'estimator', 'controller'), **changes}
    refuse_unknown_parameters(values)
    return scenario.build(values)


def limits_of_inputs(path: Path, changes: dict[str, Any], built: Scenario) -> Limits | None:
    """Return the limits of a controller's inputs; None without an input."""
    if not built.model.input.size:
        return None
    return actuators(built, {**from_file(path, 'controller'), **changes})[0]


def robustness(
    path: Path, changes: dict[str, Any], texts: Sequence[str], built: Scenario
) -> WorstCases | None:
    """Return the worst case over the intervals that a person typed, if any."""
    ends = pairs('--within', texts, INTERVAL)
    if not ends:
        return None
    values = {'model': models.DEFAULT, **from_file(path, 'estimator', 'controller'), **changes}
    return worst_cases(built, *named_plants(values, ends))


def walk(path: Path, changes: dict[str, Any], seconds: float | None) -> tuple[float, Scenario]:
    """Return the duration of the simulated path, ``seconds`` if given, and its scenario.

    The scenario has the parameters of the demo, whose rate and law suit a long run.
    """
    demo = demo_section(path)
    followed = believed(path, {**demo.parameters, **changes})
    if seconds is None:
        seconds = paths.default_seconds(followed, demo.duration or 0.0)
    return seconds, followed


def check_wiring(built: Scenario) -> tuple[str, ...]:
    """Check that every signal has fields of its message type, as nodes do at start-up.

    Return a note if message types cannot be checked because ROS is not installed.

    Raises
    ------
    ValueError
        If a type is not installed, or lacks a field; the message names the topic.
    """
    try:
        from kalman_ros.codecs.signal_codecs import codec_of
    except ImportError:
        return ('Message types and fields are not checked: no ROS is installed.',)
    for name, source in built.enabled.items():
        try:
            codec_of(source.signal)
        except ValueError as error:
            raise ValueError(f'{name}: {error}') from None
    codec_of(built.state)
    if built.model.input.size:
        codec_of(built.input)
    return ()


def main(argv: Sequence[str] | None = None) -> None:
    """Print and draw a design."""
    options = arguments(argv)
    console = Console(highlight=False)
    try:
        path = options.params_file or shipped.file(options.scenario)
        changes = overrides(options.parameters)
        built = believed(path, changes)
        unchecked = check_wiring(built)
        followed = walk(path, changes, options.duration)
        input_limits = limits_of_inputs(path, changes, built)
        report = design_theory.report(built, options.delay or 0.0, *followed, input_limits)
        worst = robustness(path, changes, options.within, built)
        folder = ready(options.out or Path('out') / path.stem / 'design')
    except (ValueError, RuntimeError, OSError) as error:
        refuse('design', error)
    latency = 1.0 / built.rate if options.delay is None else options.delay
    notes, warnings = design_warnings.notes(report), design_warnings.warnings(report, latency)

    from kalman_ros.report import (  # matplotlib is slow to load
        design_json,
        design_pictures,
        design_tables,
        sheet,
        style,
        worst_case_table,
    )

    law = f', law {built.law}' if built.law else ''
    demo = demo_section(path)
    console.print(f'[bold]{path.stem} at {built.rate:g} {demo.rate_unit}{law}[/]')
    console.print(design_tables.structure(report))
    sheet.show(console, design_tables.tables(report, demo.time_unit))
    if options.matrices:
        sheet.show(console, design_tables.matrices(report))
    console.print()
    for sentence in (*design_tables.closing(report, demo.time_unit), *notes, *unchecked):
        console.print(sentence, markup=False)
    if worst is not None:
        title = f'Worst case over {worst_case_table.over(worst)}'
        sheet.show(console, [(title, worst_case_table.table(worst))])
        console.print()
        for sentence in worst_case_table.sentences(worst):
            console.print(sentence, markup=False)
    for sentence in warnings:
        console.print(f'[yellow]Warning:[/] {sentence}')
    summary = {'scenario': path.stem, **design_json.design_json(report, notes, warnings)}
    (folder / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    about = f'{path.stem}, design at {built.rate:g} {demo.rate_unit}, filter {built.filter}{law}'
    with style.caption(about, demo.time_unit):
        drawn = design_pictures.draw_all(report, folder)
    console.print(f'In {folder}: {", ".join(["summary.json", *(p.name for p in drawn)])}')
