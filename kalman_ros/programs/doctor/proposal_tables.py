# SPDX-License-Identifier: Apache-2.0
"""The topics of a recording, and the scenarios that fit them, for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from rich.table import Table

from kalman_ros.report.run_tables import plain_table

from .proposal import Proposal, TopicRecord

#: The number of scenarios that are shown.
_SHOWN = 3


def topics_table(topics: Mapping[str, TopicRecord]) -> Table:
    """Return the topics of a recording: type, number of messages, rate in Hz, longest gap in s."""
    table = plain_table('', ('type', 'count', 'Hz', 'gap (s)'), 2)
    for topic, record in topics.items():
        kind = record.type.rpartition('/')[2]
        numbers = (
            f'{number:.4g}' if isfinite(number) else '-' for number in (record.rate, record.gap)
        )
        table.add_row(topic, kind, str(record.count), *numbers)
    return table


def matches_table(proposals: Sequence[Proposal]) -> Table:
    """Return the scenarios that fit best: their sensors, with rate and noise as measured."""
    table = plain_table('', ('sensor', 'topic', 'Hz', 'noise'), 3)
    for column in table.columns:  # noise takes several lines where the rest is wide
        column.no_wrap, column.overflow = column is not table.columns[-1], 'fold'
    for proposal in proposals[:_SHOWN]:
        name = proposal.scenario
        for sensor, match in proposal.matches.items():
            noise = ', '.join(f'{std:.3g}' for std in match.noise)
            table.add_row(name, sensor, match.topic, f'{match.rate:.4g}', noise)
            name = ''
        if proposal.input:
            table.add_row('', '(input)', proposal.input, '', '')
    return table
