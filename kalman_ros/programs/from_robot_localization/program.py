# SPDX-License-Identifier: Apache-2.0
"""Write the parameters of our estimator for a file of robot_localization, and list the rest."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Container, Sequence
from pathlib import Path

import rclpy
from rich.console import Console
from rich.table import Table
from rich.text import Text

from kalman_ros.bags.reading import Bag
from kalman_ros.core.one_line import one_line
from kalman_ros.pipeline.settings import settings
from kalman_ros.pipeline.transforms import check_frames
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario.parameter_text import section_text

from .their_file import Row, their_nodes
from .translation import ODOMETRY, Translation, translated

PROGRAM = 'from_robot_localization'
#: The most values of a file that are left out because they are out of range.
_MOST_LEFT_OUT = 20


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
    parser.add_argument(
        '--compare', metavar='BAG',
        help='replay a recording with our files, beside the output of the old filter in it',
    )  # fmt: skip
    parser.add_argument(
        '--against', default='', metavar='TOPIC',
        help=f'of that output (default: /{ODOMETRY}, where it is recorded)',
    )  # fmt: skip
    parser.add_argument(
        '--truth', default='', metavar='TOPIC', help='of true poses in that recording'
    )
    return parser.parse_args(argv)


def as_text(translation: Translation, source: str) -> str:
    """Return parameters as a ROS parameter file for a node of any name."""
    comments = [f'# From {one_line(source)}, a file of robot_localization.']
    topic = translation.odometry
    comments.append(f'# The odometry is on {topic}; for nodes that expect it elsewhere, remap it.')
    if translation.remaps:
        comments.append(f'# When this is started: --ros-args{_arguments(translation)}')
    return '\n'.join((*comments, section_text('/**', translation.values)))


def _arguments(translation: Translation) -> str:
    return ''.join(f' -r {ours}:={theirs}' for ours, theirs in translation.remaps.items())


def written(filters: Sequence[Translation], source: Path, out: Path | None) -> list[Path]:
    """Write a file for each filter, once all of them load, and return their paths.

    Raises
    ------
    ValueError
        If one does not load as a parameter file of the estimator, or two have the same file.
    """
    for translation in filters:
        try:
            _make_startable(translation)
        except ValueError as error:
            raise ValueError(f'{translation.title}: {error}') from None
    first = Path(f'{source.stem}_kalman_ros.yaml') if out is None else out
    names = [
        f'{first.stem}_{translation.title.replace("/", "_")}{first.suffix}'
        for translation in filters
    ]
    files = [first.with_name(name) for name in names] if len(filters) > 1 else [first]
    for file in files:
        if files.count(file) > 1:
            raise ValueError(f'{source.name}: two filters would be {file}')
        if file.resolve() == source.resolve():
            raise ValueError(f'--out: expected another file than {source}')
    for file, translation in zip(files, filters):
        file.write_text(as_text(translation, source.name))
        _read_back(file)
    return files


#: Their parameters by the beginnings of ours, where a value of theirs may be out of range.
_SOURCES = {
    'publish_rate': ('frequency',),
    'window': ('history_length',),
    'tf_time_offset': ('transform_time_offset',),
    'frame': ('world_frame', 'odom_frame', 'map_frame'),
    'odom_frame': ('odom_frame',),
    'child_frame': ('base_link_frame',),
    'input_timeout': ('control_timeout',),
    'initial_estimate': ('initial_state',),
    'initial_std': ('initial_estimate_covariance',),
    'model_parameters.command_time': ('control_timeout',),
    'model_parameters': ('process_noise_covariance', 'acceleration_limits', 'deceleration_limits'),
    'datum': ('datum',),
}


def _make_startable(translation: Translation) -> None:
    """Leave out the values with which no estimator starts, and list them.

    Raises
    ------
    ValueError
        If none starts without them, either.
    """
    values = translation.values
    for _ in range(_MOST_LEFT_OUT):
        try:
            known = settings(values)
            if known.options.publish_tf:
                check_frames(known.options)
            known.fusion()
            return
        except (ValueError, ArithmeticError) as error:
            words = str(error)
            if not _leave_out(translation, words):
                raise ValueError(words) from None
    raise ValueError('too many values are out of range')


def _leave_out(translation: Translation, why: str) -> bool:
    """Take the value that an error names out of a file; return whether there is one."""
    values, named = translation.values, why.partition(':')[0]
    if named == 'model_parameters' and not any(name.startswith(f'{named}.') for name in values):
        named = 'initial_estimate'  # a state so far away is as bad as such a noise
    if named == 'child_frame' and 'base_link_frame' not in translation.node.values:
        named = 'frame'
    for ours, theirs in _SOURCES.items():
        names = [name for name in values if name == named or name.startswith(f'{ours}.')]
        if not (named == ours or named.startswith(f'{ours}.')) or not names:
            continue
        for name in names if named == ours else [named]:
            before = values.pop(name, None)
            if name == 'initial_estimate' and any(before):
                values[name] = [0.0] * len(before)
        for name in theirs:
            translation.node.leave_out(name, why)
        return True
    return False


def _read_back(file: Path) -> None:
    """Raise ValueError, and remove the written file, if the parser of ROS does not read it."""
    context = rclpy.Context()
    arguments = ['--ros-args', '--params-file', str(file)]
    try:
        rclpy.init(
            args=arguments, context=context, signal_handler_options=rclpy.SignalHandlerOptions.NO
        )
    except RuntimeError as error:
        file.unlink()
        raise ValueError(f'{file.name}: ROS does not read it: {one_line(str(error))}') from None
    rclpy.shutdown(context=context)


def _shown(text: str) -> Text:
    return Text(one_line(text))


def _table(title: str, rows: Sequence[Row]) -> Table:
    table = Table(title=_shown(title), title_justify='left', box=None, title_style='bold')
    table.add_column('line', justify='right')
    table.add_column('parameter', overflow='fold')
    table.add_column('what becomes of it', overflow='fold')
    for row in sorted(rows, key=lambda row: row.line):
        table.add_row(str(row.line or '-'), _shown(row.name), _shown(row.what))
    return table


def main(argv: Sequence[str] | None = None) -> None:
    """Translate a parameter file, and print what is carried over."""
    options = arguments(argv)
    if (options.against or options.truth) and not options.compare:
        refuse(PROGRAM, ValueError('--against, --truth: expected a recording, --compare BAG'))
    try:
        recorded = Bag(options.compare).topics if options.compare else {}
        translations = translated(their_nodes(options.file))
        filters = [translation for translation in translations if translation.values]
        files = written(filters, options.file, options.out)
    except OSError as error:
        refuse(PROGRAM, ValueError(f'{error.filename}: {error.strerror}'))
    except ValueError as error:
        refuse(PROGRAM, error)
    console = Console()
    for translation in translations:
        carried = [row for row in translation.rows if row.carried]
        left = [row for row in translation.rows if not row.carried]
        if carried:
            console.print(_table(f'{translation.title}: carried over, or not needed', carried))
        if left:
            console.print(_table(f'{translation.title}: NOT carried over', left))
        console.print()
    for translation, file in zip(filters, files):
        space = f' -r __ns:=/{translation.namespace}' if translation.namespace else ''
        node = f' -r __node:={translation.name}' if len(files) > 1 else ''
        names = f'{space}{node}{_arguments(translation)}'
        command = f'ros2 run kalman_ros estimator --ros-args{names} --params-file '
        console.print(_shown(f'{translation.title}: {file}'), style='bold', soft_wrap=True)
        console.print(_shown(f'  {command}{shlex.quote(str(file))}'), soft_wrap=True)
    console.print(
        'Places of sensors: by /tf_static (mount.tf), as with robot_localization; without it, set '
        'SENSOR.mount.'
    )
    if options.compare:
        pairs = [
            (file, options.against or _recorded_output(translation, recorded))
            for translation, file in zip(filters, files)
        ]
        if not any(against for _, against in pairs):
            console.print('The recording has no output of the old filter: --against TOPIC.')
        sys.exit(max(compared(file, options, against) for file, against in pairs))


def _recorded_output(translation: Translation, recorded: Container[str]) -> str:
    """Return the topic of the old filter's odometry in a recording; '' if it has none."""
    usual = translation.remaps.get(translation.odometry, ODOMETRY)
    return next((f'/{topic}' for topic in (usual, ODOMETRY) if f'/{topic}' in recorded), '')


def compared(file: Path, options: argparse.Namespace, against: str) -> int:
    """Replay the recording with one of our files beside the old filter; return the exit code."""
    from kalman_ros.programs.replay.program import main as replay  # matplotlib is slow to load

    # at the readings: an estimate of a timer lacks the reading of the same instant
    words = [options.compare, '--params-file', str(file), '-p', 'publish_rate:=0.0']
    words += ['--out', f'out/{file.stem}/replay']
    for name, topic in (('--against', against), ('--truth', options.truth)):
        words += [name, topic] if topic else []
    try:
        replay(words)
    except SystemExit as end:
        return int(end.code or 0) if isinstance(end.code, (int, type(None))) else 2
    return 0
