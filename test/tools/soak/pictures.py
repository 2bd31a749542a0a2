# SPDX-License-Identifier: Apache-2.0
"""A long run as a table for the terminal, as a page, and as a picture."""

from __future__ import annotations

from pathlib import Path

from matplotlib.ticker import LogLocator, StrMethodFormatter
from rich.table import Table

from kalman_ros.core import Array
from kalman_ros.report.run_tables import plain_table
from kalman_ros.report.style import BOUND, ESTIMATE, INPUT, READING, TRUTH, picture

from .findings import LEAST_MEMORY, Soak

_MEGABYTE = 1e6
_COLOURS = (TRUTH, ESTIMATE, INPUT, READING)
_WARM_UP = '#eef1f3'
_TOO_SHORT = f'after {LEAST_MEMORY / 60.0:g} min'


def soak_rows(soak: Soak) -> list[tuple[str, str, str]]:
    """Return the measurements with their limits."""
    rows = [
        (
            f'growth of {name} [B/s]',
            f'{each.value:.0f} ({each.low:.0f} to {each.high:.0f})',
            f'to {soak.allowed_growth:.0f}' if soak.judges_memory else _TOO_SHORT,
        )
        for name, each in soak.growth.items()
    ]
    steps = round(soak.time[-1] * soak.rate)
    low, high, most = (f'{1e3 * value:.3g}' for value in soak.latency)
    came, fused, rejected, dropped = soak.readings
    return [
        *rows,
        (f'steps missed, of {steps}', f'{soak.missed[-1]:.0f}', ''),
        ('plant kept from running [s]', f'{soak.withheld[-1]:.2f}', ''),
        ('missed for no reason', f'{soak.unexplained}', '0'),
        ('reading to force, 50 / 90 / 99 % [ms]', f'{low} / {high} / {most}', ''),
        *(
            (f'{topic} to {receiver}, lost', f'{sent - got} of {sent}', '0')
            for topic, receiver, sent, got, _ in soak.deliveries
        ),
        ('fused + rejected + dropped', f'{fused} + {rejected} + {dropped}', f'{came}'),
        ('topics with NaN or infinity', ', '.join(soak.not_finite) or 'none', 'none'),
    ]


def soak_table(soak: Soak) -> Table:
    """Return the table for the terminal."""
    table = plain_table('', ('measured', 'allowed'))
    for row in soak_rows(soak):
        table.add_row(*(cell.replace('[', '\\[') for cell in row))
    return table


def soak_page(soak: Soak, command: str, machine: str, about: str, picture: str) -> str:
    """Return the page in Markdown."""
    verdict = '; '.join((soak.verdict, *soak.broken))
    lines = [
        '# A long run in real time',
        '',
        f'Made by `{command}` on {machine}. {about}',
        '',
        *_LEGEND,
        '',
        '| | measured | allowed |',
        '|---|--:|--:|',
        *(f'| {" | ".join(row)} |' for row in soak_rows(soak)),
        '',
        verdict,
        '',
        f'![Memory, latency and missed steps over time]({picture})',
    ]
    return '\n'.join(lines) + '\n'


_LEGEND = (
    'The time from a reading to its input starts at the stamp of the reading and includes delay',
    'faults. Memory is the resident size of each process, each second; its growth is the slope',
    'after the warm-up, with an interval that contains it in 999 of 1000 cases if means over',
    'stretches scatter about a line. 200 bytes a second are allowed, 17 MB a day, and a quarter',
    'of a megabyte once, for heaps and queues; a run of under six minutes is too short to tell.',
    'A step is missed when the plant takes it after the end of the next one. That is excused if',
    'Linux reports that the plant was ready and kept waiting, or that the host withheld the',
    'processor, for that long. Messages are counted where they are published and where they are',
    'received, after the end of the run.',
)


def draw_soak(soak: Soak, path: Path) -> None:
    """Draw memory, latency and missed steps over time."""
    with picture(path, 3, 1, (8.0, 6.4)) as (_, axes):
        memory, latency, missed = axes[:, 0]
        for (name, y), colour in zip(soak.resident.items(), _COLOURS):
            memory.plot(soak.time, _since(y, soak), color=colour, lw=1.0, label=name)
        warm = soak.time[soak.warm][0]
        memory.axvspan(0.0, warm, color=_WARM_UP, lw=0, label='warm-up')
        memory.set_title('Memory of each node, beside that at the end of the warm-up')
        memory.set_ylabel('change [MB]')
        latency.plot(soak.time, 1e3 * soak.tail, color=READING, lw=0.8, label='99 %')
        latency.plot(soak.time, 1e3 * soak.median, color=ESTIMATE, lw=1.0, label='median')
        latency.set_yscale('log')
        latency.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        latency.yaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
        latency.yaxis.set_minor_formatter(StrMethodFormatter('{x:g}'))
        latency.set_title('From a reading to its force, in each second')
        latency.set_ylabel('[ms]')
        missed.step(soak.time, soak.missed, where='post', color=TRUTH, lw=1.0, label='missed')
        withheld = soak.withheld * soak.rate
        missed.plot(soak.time, withheld, color=BOUND, lw=1.0, label='kept from running')
        missed.set_title('Steps that the plant missed, and for which it was kept from running')
        missed.set_yscale('symlog', linthresh=10.0)
        missed.yaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
        missed.set_ylim(0.0)
        missed.set_ylabel('steps so far')
        for axis in axes[:, 0]:
            axis.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))


def _since(y: Array, soak: Soak) -> Array:
    """Return memory in MB, relative to the end of the warm-up."""
    since: Array = (y - y[soak.warm][0]) / _MEGABYTE
    return since
