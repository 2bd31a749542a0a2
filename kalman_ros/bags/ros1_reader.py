# SPDX-License-Identifier: Apache-2.0
"""Reader of bags of ROS 1 (http://wiki.ros.org/Bags/Format/2.0) as messages of ROS 2.

Message definitions in a bag are not used, since code would have to be generated from them. Types
that the standard packages of ROS 2 have, too, are converted by rosbags.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Collection, Iterator
from functools import cache, partial
from pathlib import Path
from struct import Struct, error
from typing import Any

from .blocks import Block, Message, Messages, grouped
from .budget import Budget
from .compression import MISSING, Part
from .mcap import U32

_MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _INDEX, _CHUNK, _CONNECTION = 2, 4, 5, 7
_TIME = Struct('<II')
_ENTRY = Struct('<III')
#: The longest head of a record, the longest record that is read outside of a chunk, and the most
#: fields of either.
_MOST_HEAD, _MOST, _MOST_FIELDS = 1 << 16, 1 << 24, 100


@cache
def _types() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        raise ValueError(f'to read a bag of ROS 1, {MISSING}') from None
    # types of ROS 2: the header of ROS 1 has a number more, which the conversion leaves out
    return get_typestore(Stores.ROS2_JAZZY)


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Return the named values in the head of a record."""
    fields: dict[bytes, bytes] = {}
    at = 0
    while at + U32.size <= len(data):
        if len(fields) > _MOST_FIELDS:
            raise ValueError(f'a record with more than {_MOST_FIELDS} fields')
        (size,) = U32.unpack_from(data, at)
        at += U32.size
        name, _, value = data[at : at + size].partition(b'=')
        fields[name] = value
        at += size
    return fields


def _number(fields: dict[bytes, bytes], name: bytes, kind: Struct = U32) -> int:
    try:
        (value,) = kind.unpack(fields[name])
    except (KeyError, error):
        raise ValueError(f'a record without {name.decode()}') from None
    return int(value)


def _time(data: bytes) -> int:
    try:
        seconds, rest = _TIME.unpack(data)
    except error:
        raise ValueError('a record without a time') from None
    return int(seconds) * 1_000_000_000 + int(rest)


def _op(fields: dict[bytes, bytes]) -> int:
    op = fields.get(b'op', b'')
    return op[0] if op else 0


class Ros1File:
    """The topics and chunks of a bag; see `blocks.Source`.

    Parameters
    ----------
    path
        Path of the bag.
    budget
        Budget for opening the bag.

    Raises
    ------
    ValueError
        If it is not a bag of version 2.0, or the budget does not suffice.
    """

    def __init__(self, path: Path, budget: Budget) -> None:
        self._path = path
        self.topics: dict[str, set[str]] = {}
        self.blocks: list[Block] = []
        self.damage = ''
        self._connections: dict[int, tuple[str, str]] = {}
        self._scan(budget)
        if not self._connections:
            for block in self.blocks:
                deque(block.read((), budget), maxlen=0)
        for topic, kind in self._connections.values():
            self.topics.setdefault(topic, set()).add(kind)
        kinds = {kind for _, kind in self._connections.values()}
        if unknown := sorted(kinds - set(_types().fielddefs)):
            reason = f'no message of ROS 2 is known for {", ".join(unknown)}'
            self.damage = '; '.join(filter(None, (self.damage, reason)))

    def _scan(self, budget: Budget) -> None:
        chunk: Part | None = None
        times: list[int] = []
        with self._path.open('rb') as file:
            size = os.fstat(file.fileno()).st_size
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ValueError('expected a bag of ROS 1, version 2.0, which this is not')
            while (at := file.tell()) < size:
                budget.work(1)
                head = self._head(file, size)
                if head is None:
                    self.damage = f'it is cut off: {at} of {size} bytes are complete'
                    break
                fields, length = head
                after, op = file.tell() + length, _op(fields)
                if op == _INDEX and length < _MOST:
                    times = self._index(file.read(length), times)
                else:
                    self._end_chunk(chunk, times, budget)
                    chunk, times = None, []
                if op == _CHUNK:
                    kind = fields.get(b'compression', b'').decode(errors='replace')
                    chunk = Part(file.tell(), length, kind, _number(fields, b'size'))
                elif op == _CONNECTION and length < _MOST:
                    self._connect(fields, file.read(length), budget)
                file.seek(after)
        self._end_chunk(chunk, times, budget)

    @staticmethod
    def _head(file: Any, size: int) -> tuple[dict[bytes, bytes], int] | None:
        """Return the head of the next record and the length of the rest; None if cut off."""
        start = file.read(U32.size)
        if len(start) < U32.size:
            return None
        (length,) = U32.unpack(start)
        if length > _MOST_HEAD:
            raise ValueError(f'a record with a head of {length} bytes')
        head, start = file.read(length), file.read(U32.size)
        if len(start) < U32.size:
            return None
        (rest,) = U32.unpack(start)
        return None if rest > size - file.tell() else (_fields(head), rest)

    @staticmethod
    def _index(data: bytes, times: list[int]) -> list[int]:
        """Return the first and the last of some times and of those in an index of a chunk."""
        whole = len(data) // _ENTRY.size * _ENTRY.size
        times = times + [s * 1_000_000_000 + ns for s, ns, _ in _ENTRY.iter_unpack(data[:whole])]
        return [min(times), max(times)] if times else []

    def _end_chunk(self, chunk: Part | None, times: list[int], budget: Budget) -> None:
        if chunk is None:
            return
        if not times:  # no index follows it
            for fields, _ in self._records(chunk, budget):
                if _op(fields) == _MESSAGE:
                    times.append(_time(fields.get(b'time', b'')))
                    times = [min(times), max(times)]
        if times:
            budget.note()
            first, last = times
            self.blocks.append(Block(first, last, partial(self._read, chunk)))

    def _connect(self, fields: dict[bytes, bytes], data: bytes, budget: Budget) -> None:
        topic = fields.get(b'topic', b'').decode(errors='replace')
        kind = _fields(data).get(b'type', b'').decode(errors='replace')
        package, _, name = kind.partition('/')
        number = _number(fields, b'conn')
        if number not in self._connections:
            budget.note(topic + kind)
            self._connections[number] = f'/{topic.lstrip("/")}', f'{package}/msg/{name}'

    def _records(self, chunk: Part, budget: Budget) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
        """Yield head and content of the records of a chunk."""
        data = chunk.read(self._path, budget)
        start = 0
        while start + 2 * U32.size <= len(data):
            budget.work(1)
            (length,) = U32.unpack_from(data, start)
            if length > _MOST_HEAD:
                raise ValueError(f'a record with a head of {length} bytes')
            middle = start + U32.size + length
            if middle + U32.size > len(data):
                raise ValueError('a record is longer than its chunk')
            (rest,) = U32.unpack_from(data, middle)
            head, content = middle - length, middle + U32.size
            if content + rest > len(data):
                raise ValueError('a record is longer than its chunk')
            yield _fields(data[head:middle]), data[content : content + rest]
            start = content + rest

    def _read(self, chunk: Part, topics: Collection[str], budget: Budget) -> Iterator[Messages]:
        """Yield the messages of some topics in a chunk, as messages of ROS 2, in groups."""
        return grouped(self._each(chunk, topics, budget))

    def _each(self, chunk: Part, topics: Collection[str], budget: Budget) -> Iterator[Message]:
        for fields, data in self._records(chunk, budget):
            if _op(fields) == _CONNECTION:
                self._connect(fields, data, budget)
            elif _op(fields) == _MESSAGE:
                topic, name = self._connections.get(_number(fields, b'conn'), ('', ''))
                if topic in topics:
                    time = _time(fields.get(b'time', b''))
                    yield Message(time, topic, _converted(data, name))


def _converted(data: bytes, kind: str) -> bytes:
    """Return a message of ROS 1 as one of ROS 2; no bytes if it is invalid, or none is known."""
    try:
        return bytes(_types().ros1_to_cdr(data, kind))
    except Exception:  # KeyError, SerdeError, struct.error, UnicodeDecodeError, ...
        return b''
