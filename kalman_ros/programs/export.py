# SPDX-License-Identifier: Apache-2.0
"""A designed loop as C99: estimator, law and limits, with the numbers of Python."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.core import options_of
from kalman_ros.embedded.loop import Loop, loop
from kalman_ros.embedded.writing import STEPS, Built, Written, build, missing, write
from kalman_ros.nodes.controller.options import ControllerOptions
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.fusion import policy
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.design import believed, limits_of_inputs
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.idle import idle_input
from kalman_ros.scenario.motions import motion_of
from kalman_ros.scenario.parameter_files import from_file, overrides
from kalman_ros.scenario.reference_motions import along_path


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='export',
        description='Write the estimator and the controller of a scenario as C99 without heap, '
        'with test vectors, and check it against Python if there is a C compiler.',
        epilog='Exit code: 0 if all was written, and passed where it could be built; 2 otherwise.',
    )
    add_scenario(parser)
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='a new folder (default: out/SCENARIO/export)'
    )
    parser.add_argument(
        '--name', default='', help="the beginning of every public name (default: the file's)"
    )
    parser.add_argument(
        '--precision', default='float64', help='float64 or float32 (default: %(default)s)'
    )
    parser.add_argument(
        '--estimator-only', action='store_true', help='without the law of the controller'
    )
    parser.add_argument(
        '--steps', type=int, default=STEPS, metavar='N',
        help='of the run that the test vectors are of (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--no-build', action='store_true', help='do not compile, even if there is a compiler'
    )
    add_parameters(parser, 'a parameter, over those of the file')
    return parser.parse_args(argv)


def of_file(path: Path, changes: Mapping[str, Any], *, control: bool) -> Loop:
    """Return the loop of a parameter file.

    Raises
    ------
    ValueError
        If a parameter is wrong, or something is not supported.
    """
    built = believed(path, dict(changes))
    values = {**from_file(path, 'controller', 'estimator'), **changes}
    known = {option.name: option for option in options_of(EstimatorOptions)}
    options: Any = EstimatorOptions
    chosen = options(**{k: known[k].check(v) for k, v in values.items() if k in known})
    idle = idle_input(built.model, chosen.idle_input)
    limits = limits_of_inputs(path, dict(changes), built)
    estimator_policy = policy(built, replace(chosen, rest_until_input=False))
    motion = _motion(path, values, built, limits) if control else None
    (blend,) = _of_controller(values, 'transition_time')
    return loop(built, estimator_policy, limits, idle, control=control, motion=motion, blend=blend)


def _of_controller(values: Mapping[str, Any], *names: str) -> list[Any]:
    """Return options of the controller from a file, or their defaults."""
    known = {option.name: option for option in options_of(ControllerOptions)}
    return [known[name].check(values.get(name, known[name].default)) for name in names]


def _motion(
    path: Path, values: Mapping[str, Any], built: Scenario, limits: Limits | None
) -> Motion | None:
    """Return the motion along the path in the section of the demo, if the file has one."""
    corners = demo_section(path).path
    if corners is None:
        return None
    names = ('path_speed', 'path_acceleration', 'path_tolerance')
    speed, acceleration, tolerance = _of_controller(values, *names)
    points = np.hstack((corners, np.zeros((len(corners), 1))))
    reference = partial(along_path, built, points, speed, acceleration, rounding=tolerance)
    return motion_of(built, reference, limits, tolerance)


def report(console: Console, written: Written, built: Built | None) -> None:
    """Print what was written, and its sizes."""
    listed = f'In {written.folder}: {", ".join(written.files)}'
    console.print(listed, soft_wrap=True, markup=False)
    console.print(f'Test vectors: {written.calls} calls of a simulated run, by Python.')
    if built is None:
        tool = missing()
        why = f', for there is no {tool.removeprefix("a ")} here' if tool else ''
        console.print(f'It was not built{why}: make check does that.')
        return
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column(f'Built by {built.command} -O2, on this machine')
    table.add_column('', justify='right')
    for row in built.rows:
        table.add_row(*row)
    console.print(table)
    console.print(f'PASS: {written.calls} calls as in Python')


def main(argv: Sequence[str] | None = None) -> None:
    """Export a scenario."""
    options = arguments(argv)
    console = Console(highlight=False)
    try:
        path = shipped.file(options.scenario)
        exported = of_file(path, overrides(options.parameters), control=not options.estimator_only)
        folder = options.out or Path('out') / path.stem / 'export'
        name = options.name or path.stem
        written = write(exported, folder, name, options.precision, path.name, steps=options.steps)
        built = None if options.no_build else build(written)
    except (ValueError, RuntimeError, OSError) as error:
        refuse('export', error)
    report(console, written, built)
