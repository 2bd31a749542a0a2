# SPDX-License-Identifier: Apache-2.0
"""Writes the parameters of our estimator for a file of robot_localization, and what is left."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from kalman_ros.pipeline.settings import settings
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario.parameter_text import section_text

from .their_file import Row, their_nodes
from .translation import Translation, translated

PROGRAM = 'from_robot_localization'


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description='Write our parameter file for one of robot_localization, and list what is '
        'carried over, and what is not, with the reason and the line.',
        epilog='Each filter in it becomes a file. Exit code: 0 if all of them load, 2 otherwise.',
    )
    parser.add_argument('file', type=Path, help='parameters of ekf_node or ukf_node')
    parser.add_argument(
        '--out', type=Path, metavar='FILE',
        help='our file (default: FILE_kalman_ros.yaml here); with several filters, one each',
    )  # fmt: skip
    return parser.parse_args(argv)


def as_text(values: Mapping[str, Any], source: str) -> str:
    """Return parameters as a ROS parameter file for a node of any name."""
    return f'# From {source}, a file of robot_localization.\n{section_text("/**", values)}'


def written(found: Sequence[Translation], source: Path, out: Path | None) -> dict[str, Path]:
    """Write a file for each filter, once all of them load, and return them by its name.

    Raises
    ------
    ValueError
        If one does not load as a parameter file of the estimator.
    """
    filters = [each for each in found if each.values]
    for each in filters:
        try:
            settings(each.values)
        except ValueError as error:
            raise ValueError(f'{each.name}: {error}') from None
    first = Path(f'{source.stem}_kalman_ros.yaml') if out is None else out
    files = {}
    for each in filters:
        name = f'{first.stem}_{each.name}{first.suffix}' if len(filters) > 1 else first.name
        files[each.name] = first.with_name(name)
        files[each.name].write_text(as_text(each.values, source.name))
    return files


def _table(title: str, rows: Sequence[Row]) -> Table:
    table = Table(title=title, title_justify='left', box=None, title_style='bold')
    table.add_column('line', justify='right')
    table.add_column('parameter', overflow='fold')
    table.add_column('what becomes of it', overflow='fold')
    for row in sorted(rows, key=lambda row: row.line):
        table.add_row(str(row.line), Text(row.name), Text(row.what))
    return table


def main(argv: Sequence[str] | None = None) -> None:
    """Run the program."""
    options = arguments(argv)
    try:
        found = translated(their_nodes(options.file))
        files = written(found, options.file, options.out)
    except OSError as error:
        refuse(PROGRAM, ValueError(f'{error.filename}: {error.strerror}'))
    except ValueError as error:
        refuse(PROGRAM, error)
    console = Console()
    for each in found:
        carried = [row for row in each.rows if row.carried]
        left = [row for row in each.rows if not row.carried]
        console.print(_table(f'{each.name}: carried over, or not needed', carried))
        if left:
            console.print(_table(f'{each.name}: NOT carried over', left))
        console.print()
    for name, file in files.items():
        node = f' -r __node:={name}' if len(files) > 1 else ''
        console.print(f'[bold]{name}[/]: {file}', soft_wrap=True)
        command = f'ros2 run kalman_ros estimator --ros-args{node} --params-file {file}'
        console.print(f'  {command}', soft_wrap=True, highlight=False)
    console.print(
        'Where sensors are is not in such a file: declare SENSOR.frame and SENSOR.mount.'
    )
