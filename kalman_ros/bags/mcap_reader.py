# SPDX-License-Identifier: Apache-2.0
"""Reader of MCAP files: complete ones, and those of a recorder that was killed.

Only the heads of the records are read to find the chunks, so that neither the summary nor the
end of the file is needed, and a chunk is in memory only while it is read.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from zlib import crc32

from . import mcap
from .blocks import GROUP, Block, Messages
from .budget import Budget
from .compression import Part

#: Bytes of the parts in which messages outside of chunks are read.
_PART = 1 << 22
#: Longest record of a topic or a type that is read.
_MOST = 1 << 20


class McapFile:
    """The topics and chunks of a file; see `blocks.Source`.

    Parameters
    ----------
    path
        Path of the file.
    budget
        Budget for opening the file.

    Raises
    ------
    ValueError
        If it is not an MCAP file, or the budget does not suffice.
    """

    def __init__(self, path: Path, budget: Budget) -> None:
        self._path = path
        self.topics: dict[str, set[str]] = {}
        self.blocks: list[Block] = []
        self.damage = ''
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, mcap.Channel] = {}
        self._ended = False
        self._scan(budget)
        if not self._channels:  # an unfinished file may have them in its chunks alone
            for block in self.blocks:
                deque(block.read((), budget), maxlen=0)
        for channel in self._channels.values():
            kind = self._schemas.get(channel.schema, '')
            known = kind if channel.encoding == 'cdr' else f'{kind} in {channel.encoding}'
            self.topics.setdefault(channel.topic, set()).add(known)

    def _scan(self, budget: Budget) -> None:
        with self._path.open('rb') as file:
            size = os.fstat(file.fileno()).st_size
            if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
                raise ValueError('expected an MCAP file, which this is not')
            loose: list[int] = []
            while (at := file.tell()) < size:
                budget.work(1)
                head = file.read(mcap.RECORD.size)
                if len(head) < mcap.RECORD.size:
                    break
                kind, length = mcap.RECORD.unpack(head)
                if length > size - file.tell():
                    break
                if kind == mcap.MESSAGE:
                    more = file.read(mcap.MESSAGE_FIELDS.size)
                    self._loose(loose, at, head + more, budget)
                elif kind == mcap.CHUNK:
                    self._chunk(file.read(min(length, 100)), file.tell(), length, budget)
                elif kind in (mcap.SCHEMA, mcap.CHANNEL) and length < _MOST:
                    self._learn(kind, file.read(length), budget)
                elif kind == mcap.DATA_END:
                    self._ended = True
                file.seek(at + mcap.RECORD.size + length)
                if kind == mcap.FOOTER:
                    break
            if not self._ended:
                self.damage = f'it was not finished: {at} of {size} bytes are complete'
            self._end_loose(loose, budget)

    def _learn(self, kind: int, data: bytes, budget: Budget) -> None:
        if kind == mcap.SCHEMA:
            number, name = mcap.read_schema(data)
            if number not in self._schemas:
                budget.note(name)
                self._schemas[number] = name
        else:
            number, channel = mcap.read_channel(data)
            if number not in self._channels:
                budget.note(channel.topic + channel.encoding)
                self._channels[number] = channel

    def _add(self, block: Block, budget: Budget) -> None:
        budget.note()
        self.blocks.append(block)

    def _chunk(self, head: bytes, after: int, length: int, budget: Budget) -> None:
        """Add the chunk whose record of some length begins with ``head``."""
        fields = mcap.Fields(head)
        start, end, size = (fields.number(mcap.U64) for _ in range(3))
        crc, kind, stored = fields.number(mcap.U32), fields.text(), fields.number(mcap.U64)
        before = mcap.CHUNK_FIELDS.size + 4 + len(kind) + 8
        if stored != length - before:
            raise ValueError(f'a chunk of {stored} bytes in a record of {length}')
        where = after - len(head) + before
        if start <= end:
            read = partial(self._read, Part(where, stored, kind, size), crc)
            self._add(Block(start, end, read), budget)

    def _loose(self, loose: list[int], at: int, head: bytes, budget: Budget) -> None:
        """Add a message outside of chunks."""
        if len(head) < mcap.MESSAGE_RECORD.size:
            return
        _, length, _, _, time, _ = mcap.MESSAGE_RECORD.unpack(head)
        end = at + mcap.RECORD.size + length
        if loose and (end - loose[0] > _PART or at != loose[1]):
            self._end_loose(loose, budget)
        if not loose:
            loose[:] = [at, end, time, time]
        loose[1:] = [end, min(loose[2], time), max(loose[3], time)]

    def _end_loose(self, loose: list[int], budget: Budget) -> None:
        if loose:
            at, end, first, last = loose
            part = Part(at, end - at, '', end - at)
            self._add(Block(first, last, partial(self._read, part, 0)), budget)
            loose.clear()

    def _read(
        self, part: Part, crc: int, topics: Collection[str], budget: Budget
    ) -> Iterator[Messages]:
        """Yield the messages of some topics in a chunk, and learn the topics in it."""
        data = part.read(self._path, budget)
        if crc and crc32(data) != crc:
            raise ValueError(f'the chunk at byte {part.at} is damaged: its checksum differs')
        unpack, size = mcap.MESSAGE_RECORD.unpack_from, mcap.MESSAGE_RECORD.size
        channels, unwanted, messages = self._channels, 0, Messages()
        times, names, contents, publications = messages.columns
        at, last = 0, len(data) - size
        while at <= last:
            kind, length, number, _, time, published = unpack(data, at)
            end = at + mcap.RECORD.size + length
            if end > len(data):
                raise ValueError('a message is longer than its chunk')
            channel = channels.get(number) if kind == mcap.MESSAGE else None
            if channel is not None and channel.topic in topics:
                times.append(time)
                names.append(channel.topic)
                contents.append(data[at + size : end])
                publications.append(published)
                if len(times) == GROUP:
                    yield messages
                    messages = Messages()
                    times, names, contents, publications = messages.columns
            else:
                unwanted += 1
                if kind in (mcap.SCHEMA, mcap.CHANNEL) and length < _MOST:
                    self._learn(kind, data[at + mcap.RECORD.size : end], budget)
            at = end
        budget.work(unwanted)
        yield messages
