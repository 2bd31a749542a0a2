# SPDX-License-Identifier: Apache-2.0
"""Reads MCAP files: complete ones, and those of a recorder that was killed.

Only the heads of the records are read to find the chunks, so that neither the summary nor the
end of the file is needed, and a chunk is in memory only while it is read.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from zlib import crc32

from . import mcap
from .blocks import MOST_BLOCK, Block, Message
from .compression import expand

#: Messages outside of chunks are read in parts of N bytes.
_PART = 1 << 22
#: The longest record of a topic or a type that is read.
_MOST = 1 << 20


class McapFile:
    """The topics and chunks of a file; see `blocks.Source`.

    Raises
    ------
    ValueError
        If it is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics: dict[str, set[str]] = {}
        self.blocks: list[Block] = []
        self.damage = ''
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, mcap.Channel] = {}
        self._ended = False
        self._scan()
        if not self._channels:  # an unfinished file may have them in its chunks alone
            for block in self.blocks:
                block.read(())
        for channel in self._channels.values():
            kind = self._schemas.get(channel.schema, '')
            known = kind if channel.encoding == 'cdr' else f'{kind} in {channel.encoding}'
            self.topics.setdefault(channel.topic, set()).add(known)

    def _scan(self) -> None:
        with self._path.open('rb') as file:
            size = os.fstat(file.fileno()).st_size
            if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
                raise ValueError('expected an MCAP file, which this is not')
            loose: list[int] = []
            while (at := file.tell()) < size:
                head = file.read(mcap.RECORD.size)
                if len(head) < mcap.RECORD.size:
                    break
                kind, length = mcap.RECORD.unpack(head)
                if length > size - file.tell():
                    break
                if kind == mcap.MESSAGE:
                    self._loose(loose, at, head + file.read(mcap.MESSAGE_FIELDS.size))
                elif kind == mcap.CHUNK:
                    self._chunk(file.read(min(length, 100)), file.tell(), length)
                elif kind in (mcap.SCHEMA, mcap.CHANNEL) and length < _MOST:
                    self._learn(kind, file.read(length))
                elif kind == mcap.DATA_END:
                    self._ended = True
                file.seek(at + mcap.RECORD.size + length)
                if kind == mcap.FOOTER:
                    break
            if not self._ended:
                self.damage = f'it was not finished: {at} of {size} bytes are complete'
            self._end_loose(loose)

    def _learn(self, kind: int, data: bytes) -> None:
        if kind == mcap.SCHEMA:
            number, name = mcap.read_schema(data)
            self._schemas.setdefault(number, name)
        else:
            number, channel = mcap.read_channel(data)
            self._channels.setdefault(number, channel)

    def _chunk(self, head: bytes, after: int, length: int) -> None:
        """Note where a chunk is, whose record of some length begins with ``head``."""
        fields = mcap.Fields(head)
        start, end, size = (fields.number(mcap.U64) for _ in range(3))
        crc, kind, stored = fields.number(mcap.U32), fields.text(), fields.number(mcap.U64)
        before = mcap.CHUNK_FIELDS.size + 4 + len(kind) + 8
        if stored != length - before or max(stored, size) > MOST_BLOCK:
            raise ValueError(f'a chunk of {stored} bytes in a record of {length}')
        where = after - len(head) + before
        if start <= end:
            read = partial(self._read, where, stored, kind, size, crc)
            self.blocks.append(Block(start, end, read))

    def _loose(self, loose: list[int], at: int, head: bytes) -> None:
        """Add a message outside of chunks."""
        if len(head) < mcap.MESSAGE_RECORD.size:
            return
        _, length, _, _, time, _ = mcap.MESSAGE_RECORD.unpack(head)
        if length > MOST_BLOCK:
            raise ValueError(f'a message of {length} bytes')
        end = at + mcap.RECORD.size + length
        if loose and (end - loose[0] > _PART or at != loose[1]):
            self._end_loose(loose)
        if not loose:
            loose[:] = [at, end, time, time]
        loose[1:] = [end, min(loose[2], time), max(loose[3], time)]

    def _end_loose(self, loose: list[int]) -> None:
        if loose:
            at, end, first, last = loose
            size = end - at
            self.blocks.append(Block(first, last, partial(self._read, at, size, '', size, 0)))
            loose.clear()

    def _read(
        self, at: int, stored: int, kind: str, size: int, crc: int, topics: Collection[str]
    ) -> list[Message]:
        """Return the messages of some topics in a chunk, and learn of the topics in it."""
        with self._path.open('rb') as file:
            file.seek(at)
            data = expand(file.read(stored), kind, size)
        if crc and crc32(data) != crc:
            raise ValueError(f'the chunk at byte {at} is damaged: its checksum differs')
        return list(self._messages(data, topics))

    def _messages(self, data: bytes, topics: Collection[str]) -> Iterator[Message]:
        unpack, size = mcap.MESSAGE_RECORD.unpack_from, mcap.MESSAGE_RECORD.size
        wanted = {n: found.topic for n, found in self._channels.items() if found.topic in topics}
        at, last = 0, len(data) - size
        while at <= last:
            kind, length, channel, _, time, published = unpack(data, at)
            end = at + mcap.RECORD.size + length
            if end > len(data):
                raise ValueError('a message is longer than its chunk')
            if kind == mcap.MESSAGE:
                if channel in wanted:
                    content = data[at + size : end]
                    yield Message(time, wanted[channel], content, published)
            elif kind in (mcap.SCHEMA, mcap.CHANNEL):
                self._learn(kind, data[at + mcap.RECORD.size : end])
                found = self._channels.get(channel)
                if kind == mcap.CHANNEL and found is not None and found.topic in topics:
                    wanted[channel] = found.topic
            at = end
