# SPDX-License-Identifier: Apache-2.0
"""Reader of the SQLite files of rosbag2, in slices of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Generator, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from .blocks import Block, Message, Messages, grouped
from .budget import Budget

#: Average number of messages in a slice, and the largest number of slices.
_SLICE, _MOST_SLICES = 2000, 100_000
#: Largest size of the table of topics, in bytes.
_MOST_TOPICS = 1 << 24
#: Condition for values of another type: a number for the bytes would be taken for their count.
_OTHER = "typeof(data) != 'blob' OR typeof(timestamp) != 'integer'"
#: Steps of SQLite between two checks of the budget, and steps that count as a record: a row takes
#: about thirty in a pass.
_LOOK, _STEPS = 1000, 100
#: Actions and names that a query may use, since a schema may contain anything else.
_TABLES = {'topics', 'messages'}
_ALLOWED: dict[int, set[str | None]] = {
    sqlite3.SQLITE_SELECT: {None},
    sqlite3.SQLITE_READ: {*_TABLES, 'sqlite_master', 'sqlite_schema'},
    sqlite3.SQLITE_PRAGMA: {'table_xinfo'},
    sqlite3.SQLITE_FUNCTION: {'count', 'length', 'max', 'min', 'sum', 'typeof'},
}


class SqliteFile:
    """The topics of a file and its slices of time; see `blocks.Source`.

    Parameters
    ----------
    path
        Path of the file.
    budget
        Budget for opening the file.

    Raises
    ------
    ValueError
        If it is not such a file, or the budget does not suffice.
    """

    damage = ''

    def __init__(self, path: Path, budget: Budget) -> None:
        self._path = path
        self.topics: dict[str, set[str]] = {}
        self.blocks: list[Block] = []
        self._names: dict[int, str] = {}
        try:
            with self._open(budget) as file:
                self._check_tables(file)
                self._read_topics(file, budget)
                self._slice(file, budget)
        except sqlite3.Error as error:
            raise ValueError(f'expected an SQLite file of rosbag2: {error}') from None

    @contextmanager
    def _open(self, budget: Budget) -> Iterator[sqlite3.Connection]:
        """Open the file for queries of two tables, whose steps are work of the budget."""
        address = f'{self._path.resolve().as_uri()}?mode=ro'
        with closing(sqlite3.connect(address, uri=True)) as file:
            file.execute('PRAGMA trusted_schema = OFF')
            file.set_authorizer(_authorize)
            stopped: list[BaseException] = []
            watch = _watch(budget, stopped)
            next(watch)
            file.set_progress_handler(watch.__next__, _LOOK)
            try:
                yield file
            except sqlite3.Error:
                if stopped:
                    raise stopped[0] from None
                raise

    @staticmethod
    def _check_tables(file: sqlite3.Connection) -> None:
        """Refuse views, virtual tables and generated columns, whose values are computed."""
        # a virtual table has no page
        tables = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
        missing = _TABLES - {str(name) for (name,) in file.execute(tables)}
        if missing:
            raise ValueError(f'expected a recording of rosbag2, without {min(missing)}')
        for table in sorted(_TABLES):
            for _, name, *_, hidden in file.execute(f'PRAGMA table_xinfo({table})'):
                if hidden:
                    raise ValueError(f'expected plain columns, {table}.{name} is generated')

    def _read_topics(self, file: sqlite3.Connection, budget: Budget) -> None:
        size = 'sum(length(name) + length(type) + length(serialization_format))'
        ((size,),) = file.execute(f'SELECT {size} FROM topics')
        if (size or 0) > _MOST_TOPICS:
            raise ValueError(f'topics of {size} bytes, more than {_MOST_TOPICS}')
        for number, name, kind, form in file.execute(
            'SELECT id, name, type, serialization_format FROM topics'
        ):
            budget.note(str(name))
            known = str(kind) if form == 'cdr' else f'{kind} in {form}'
            self.topics.setdefault(str(name), set()).add(known)
            if isinstance(number, int):
                self._names[number] = str(name)

    def _slice(self, file: sqlite3.Connection, budget: Budget) -> None:
        ((first, last, count),) = file.execute(
            'SELECT min(timestamp), max(timestamp), count(*) FROM messages'
        )
        if not count:
            return
        if not isinstance(first, int) or not isinstance(last, int):
            raise ValueError('expected the times of messages as whole numbers')
        self._divide(file, first, last, count, budget)

    def _divide(
        self, file: sqlite3.Connection, first: int, last: int, count: int, budget: Budget
    ) -> None:
        """Add blocks of equal duration, and divide those that hold many messages again.

        Otherwise one message from before the clock was set would leave all others in one block.
        """
        slices = min(max(1, count // _SLICE), _MOST_SLICES)
        width = (last - first) // slices + 1
        counts: dict[int, int] = {}
        if slices > 1:
            shares = file.execute(
                'SELECT CAST((timestamp - ?) / ? AS INTEGER), count(*) FROM messages '
                'WHERE timestamp BETWEEN ? AND ? GROUP BY 1',
                (first, float(width), first, last),
            )
            counts = dict(shares.fetchall())
        for number, start in enumerate(range(first, last + 1, width)):
            budget.note()
            end = min(start + width - 1, last)
            if counts.get(number, 0) > 4 * _SLICE and width > 1:
                self._divide(file, start, end, counts[number], budget)
            else:
                self.blocks.append(Block(start, end, partial(self._read, start, end)))

    def _read(
        self, start: int, end: int, topics: Collection[str], budget: Budget
    ) -> Iterator[Messages]:
        """Yield the messages of some topics in a slice."""
        numbers = [number for number, name in self._names.items() if name in topics]
        where = (
            'FROM messages WHERE timestamp BETWEEN ? AND ? '
            f'AND topic_id IN ({",".join(map(str, numbers))})'
        )
        try:
            with self._open(budget) as file:
                ((size, others),) = file.execute(
                    f'SELECT sum(length(data)), sum({_OTHER}) {where}', (start, end)
                )
                if others:
                    raise ValueError(f'{others} messages without a time or without bytes')
                budget.expand(0, size or 0)
                rows = file.execute(
                    f'SELECT timestamp, topic_id, data {where} ORDER BY timestamp, id',
                    (start, end),
                )
                yield from grouped(
                    Message(time, self._names[number], bytes(data)) for time, number, data in rows
                )
        except sqlite3.Error as error:
            raise ValueError(f'damaged: {error}') from None


def _authorize(action: int, first: str | None, second: str | None, *_: Any) -> int:
    """Return whether SQLite may do what a query requests."""
    name = second if action == sqlite3.SQLITE_FUNCTION else first
    return sqlite3.SQLITE_OK if name in _ALLOWED.get(action, ()) else sqlite3.SQLITE_DENY


def _watch(budget: Budget, stopped: list[BaseException]) -> Generator[int, None, None]:
    """Yield, each time that SQLite asks, whether it must stop, and keep the reason.

    SQLite drops what is raised here, by the budget or the handler of a signal. The handler runs
    before a bytecode, which in a generator is inside of the ``try``, the jump of the loop
    included, and in a function may be before it.
    """
    try:
        while True:
            yield 0
            budget.work(_LOOK // _STEPS)
    except GeneratorExit:
        raise
    except BaseException as error:
        stopped.append(error)
        while True:
            yield 1
