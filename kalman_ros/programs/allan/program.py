# SPDX-License-Identifier: Apache-2.0
"""Noise density and bias instability of an inertial sensor, from a recording at rest."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console

from kalman_ros.analysis.allan import Allan, Parameter, allan
from kalman_ros.bags.reading import Bag
from kalman_ros.programs.common_arguments import add_part
from kalman_ros.programs.refusal import interruptible, refuse
from kalman_ros.programs.results import ready
from kalman_ros.report.sheet import Sheet, show

from .channels import NAMES, UNITS, Channels, channels, topics

_PARAMETERS = (
    ('density', 'noise density', '/sqrt(Hz)'),
    ('instability', 'bias instability', ''),
    ('random_walk', 'bias random walk', '/sqrt(s)'),
)


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='allan',
        description='Estimate the noise of an inertial sensor from a recording in which it does '
        'not move, by its Allan deviation.',
    )
    parser.add_argument('bag', help='a recording: a folder of rosbag2, or a file')
    parser.add_argument('topic', nargs='?', default='', help='default: each with sensor_msgs/Imu')
    add_part(parser)
    parser.add_argument(
        '--out', type=Path, default=Path('out/allan'), metavar='DIR',
        help='for the results (default: %(default)s)',
    )  # fmt: skip
    return parser.parse_args(argv)


@interruptible('allan')
def main(argv: Sequence[str] | None = None) -> None:
    """Print the noise parameters of each sensor, with intervals, and draw the deviations."""
    options, console = arguments(argv), Console(highlight=False)
    try:
        bag, part = Bag(options.bag), (options.start, options.end)
        recorded = {topic: channels(bag, topic, part) for topic in topics(bag, options.topic)}
        ready(options.out)
        results = {topic: _deviations(readings) for topic, readings in recorded.items()}
    except ValueError as error:
        refuse('allan', error)

    from kalman_ros.report.style import caption  # matplotlib loads while nothing waits

    from .picture import allan_picture

    names, summary = ['summary.json'], {}
    for topic, readings in recorded.items():
        _show(console, readings, results[topic])
        names.append(f'{topic.strip("/").replace("/", "_")}.png')
        at_rest = f'{results[topic][0].duration:.4g} s at rest'
        with caption(f'allan, {Path(options.bag).name}, {topic}: {at_rest}'):
            allan_picture(results[topic], options.out / names[-1])
        summary[topic] = {
            'rate': 1.0 / readings.period,
            'duration': results[topic][0].duration,
            'channels': {
                name: {key: asdict(getattr(result, key)) for key, _, _ in _PARAMETERS}
                for name, result in zip(NAMES, results[topic])
            },
        }
    (options.out / 'summary.json').write_text(json.dumps(summary, indent=2) + '\n')
    console.print(f'\nIn {options.out}: {", ".join(names)}')


def _deviations(readings: Channels) -> list[Allan]:
    """Return the deviation of each channel; a ValueError names the channel."""
    results = []
    for name, values in zip(NAMES, readings.values.T):
        try:
            results.append(allan(values, readings.period))
        except ValueError as error:
            raise ValueError(f'{readings.topic}, {name}: {error}') from None
    return results


def _show(console: Console, readings: Channels, results: Sequence[Allan]) -> None:
    duration, rate = _span(results[0].duration), 1.0 / readings.period
    count = len(readings.values)
    console.print(f'[bold]{readings.topic}[/]: {count} readings, {rate:.4g} Hz, {duration}')
    if count < readings.whole:
        console.print(
            f'The longest part without a gap is used, {count} of {readings.whole} readings; gaps: '
            f'{readings.gaps}.'
        )
    if readings.dropped:
        console.print(f'Messages that cannot be decoded, or are not finite: {readings.dropped}.')
    for key, title, per in _PARAMETERS:
        cells = [_cells(getattr(result, key)) for result in results]
        titles = (title, '95 % interval', 'at \\[s]')
        columns: list[tuple[str, Sequence[str]]] = [('unit', [f'{unit}{per}' for unit in UNITS])]
        columns += zip(titles, zip(*cells))
        show(console, [(title.capitalize(), Sheet(NAMES, columns))])
    needed = {
        name: result.needed()
        for name, result in zip(NAMES, results)
        if not result.instability.determined
    }
    if needed:
        console.print(
            f'\n{duration} do not determine the bias instability of {", ".join(needed)}. '
            f'A recording of {_span(max(needed.values()))} may.'
        )
    console.print('\n[bold]For a parameter file[/]')
    for part, unit in ((slice(0, 3), 'rad/s'), (slice(3, 6), 'm/s^2')):
        densities = [result.density for result in results[part]]
        unknown = [name for name, density in zip(NAMES[part], densities) if not density.determined]
        if unknown:
            console.print(f'# no noise in {unit}: {", ".join(unknown)} not determined')
            continue
        std = [density.value / np.sqrt(readings.period) for density in densities]
        values = ', '.join(f'{value:.3g}' for value in std)
        axes = ', '.join(NAMES[part])
        console.print(f'noise: \\[{values}]   # {unit}: {axes}', soft_wrap=True)
    for name, result, unit in zip(NAMES, results, UNITS):
        if result.random_walk.determined:
            square = result.random_walk.value**2
            console.print(f'bias noise: {square:.3g}   # ({unit})^2/s: {name}', soft_wrap=True)


def _cells(parameter: Parameter) -> tuple[str, str, str]:
    if not parameter.determined:
        return 'not determined', '', ''
    return (
        f'{parameter.value:.3g}',
        f'{parameter.low:.3g} to {parameter.high:.3g}',
        f'{parameter.time:.3g}',
    )


def _span(seconds: float) -> str:
    """Return a duration in the unit that a person would use."""
    for size, unit in ((3600.0, 'h'), (60.0, 'min')):
        if seconds >= 2.0 * size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds:.3g} s'
