# SPDX-License-Identifier: Apache-2.0
"""Reads the SQLite files of rosbag2, in slices of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from functools import partial
from pathlib import Path

from .blocks import MOST_BLOCK, Block, Message

#: Messages of a slice, on average, and the most slices.
_SLICE, _MOST_SLICES = 2000, 100_000
#: Any column may have values of any type; a number for its bytes would be taken for their count.
_OTHER = "typeof(data) != 'blob' OR typeof(timestamp) != 'integer'"


class SqliteFile:
    """The topics of a file and its slices of time; see `blocks.Source`.

    Raises
    ------
    ValueError
        If it is no such file.
    """

    damage = ''

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics: dict[str, set[str]] = {}
        self.blocks: list[Block] = []
        try:
            self._look()
        except sqlite3.Error as error:
            raise ValueError(f'expected an SQLite file of rosbag2: {error}') from None

    def _open(self) -> sqlite3.Connection:
        found = sqlite3.connect(f'{self._path.resolve().as_uri()}?mode=ro', uri=True)
        found.execute('PRAGMA trusted_schema = OFF')
        return found

    def _look(self) -> None:
        with self._open() as file:
            # a view could keep its reader busy for ever
            tables = "SELECT name FROM sqlite_master WHERE type = 'table'"
            missing = {'topics', 'messages'} - {str(name) for (name,) in file.execute(tables)}
            if missing:
                raise ValueError(f'expected a recording of rosbag2, without {min(missing)}')
            for name, kind, form in file.execute(
                'SELECT name, type, serialization_format FROM topics'
            ):
                known = str(kind) if form == 'cdr' else f'{kind} in {form}'
                self.topics.setdefault(str(name), set()).add(known)
            first, last, count = file.execute(
                'SELECT min(timestamp), max(timestamp), count(*) FROM messages'
            ).fetchone()
        file.close()
        if not count:
            return
        if not isinstance(first, int) or not isinstance(last, int):
            raise ValueError('expected the times of messages as whole numbers')
        slices = min(max(1, count // _SLICE), _MOST_SLICES)
        width = (last - first) // slices + 1
        for start in range(first, last + 1, width):
            end = start + width - 1
            self.blocks.append(Block(start, end, partial(self._read, start, end)))

    def _read(self, start: int, end: int, topics: Collection[str]) -> list[Message]:
        """Return the messages of some topics in a slice."""
        marks = ','.join('?' * len(topics))
        where = (
            'FROM messages JOIN topics ON messages.topic_id = topics.id '
            f'WHERE timestamp BETWEEN ? AND ? AND topics.name IN ({marks})'
        )
        try:
            with self._open() as file:
                values = (start, end, *topics)
                size, others = file.execute(
                    f'SELECT sum(length(data)), sum({_OTHER}) {where}', values
                ).fetchone()
                if others:
                    raise ValueError(f'{others} messages without a time or without bytes')
                if (size or 0) > MOST_BLOCK:
                    raise ValueError(f'{size} bytes of messages in {(end - start) * 1e-9:g} s')
                found = file.execute(
                    f'SELECT timestamp, name, data {where} ORDER BY timestamp, messages.id', values
                ).fetchall()
            file.close()
        except sqlite3.Error as error:
            raise ValueError(f'damaged: {error}') from None
        return [Message(time, topic, bytes(data)) for time, topic, data in found]
