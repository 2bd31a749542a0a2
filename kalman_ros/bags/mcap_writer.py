# SPDX-License-Identifier: Apache-2.0
"""Writer of MCAP files that can be read at any moment, up to the last flush."""

from __future__ import annotations

from array import array
from pathlib import Path
from zlib import crc32

from . import mcap

#: Bytes after which a chunk is written, if it was not flushed before.
_CHUNK = 1 << 20


class McapWriter:
    """An MCAP file with the profile of ROS 2, in chunks that are not compressed.

    Parameters
    ----------
    path
        Path of the file, which must not exist.
    library
        Name of the library that writes the file, which the file contains.
    """

    def __init__(self, path: Path, library: str) -> None:
        self._file = path.open('xb')
        self._at = 0
        #: Records of types and topics, which the summary repeats.
        self._schemas: dict[str, bytes] = {}
        self._channels: list[bytes] = []
        self._chunks: list[bytes] = []
        self.counts: list[int] = []
        self.start, self.end = 2**64 - 1, 0
        self._begin()
        self._put(mcap.MAGIC)
        self._put(mcap.record(mcap.HEADER, mcap.text('ros2') + mcap.text(library)))
        self._file.flush()

    def _begin(self) -> None:
        self._chunk = bytearray()
        self._first, self._last = 2**64 - 1, 0
        self._index: dict[int, array[int]] = {}

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._at += len(data)

    def add(self, topic: str, kind: str, definition: str, metadata: dict[str, str]) -> int:
        """Add a topic with the name and the definition of its type, and return its number."""
        if kind not in self._schemas:
            self._schemas[kind] = mcap.schema(len(self._schemas) + 1, kind, definition)
            self._put(self._schemas[kind])
        number = len(self._channels)
        schema = [*self._schemas].index(kind) + 1
        self._channels.append(mcap.channel(number, schema, topic, metadata))
        self.counts.append(0)
        self._put(self._channels[-1])
        return number

    def write(self, channel: int, time: int, data: bytes, published: int) -> None:
        """Add a message to the topic with that number.

        It was received at ``time`` and ``published`` at another, both in nanoseconds.
        """
        chunk = self._chunk
        self._index.setdefault(channel, array('Q')).extend((time, len(chunk)))
        size = mcap.MESSAGE_FIELDS.size + len(data)
        number = self.counts[channel]
        chunk += mcap.MESSAGE_RECORD.pack(mcap.MESSAGE, size, channel, number, time, published)
        chunk += data
        self.counts[channel] = number + 1
        if time < self._first:
            self._first = time
        if time > self._last:
            self._last = time
        if len(chunk) > _CHUNK:
            self._end_chunk()

    def flush(self) -> None:
        """Hand all messages to the system: they stay in the file if this process is killed."""
        self._end_chunk()
        self._file.flush()

    def _end_chunk(self) -> None:
        if not self._chunk:
            return
        data, start = bytes(self._chunk), self._at
        times = self._first, self._last
        fields = mcap.CHUNK_FIELDS.pack(*times, len(data), crc32(data))
        self._put(
            mcap.record(mcap.CHUNK, fields + mcap.text('') + mcap.U64.pack(len(data)) + data)
        )
        length, offsets = self._at - start, b''
        for channel, entries in self._index.items():
            offsets += mcap.U16.pack(channel) + mcap.U64.pack(self._at)
            content = entries.tobytes()
            index = mcap.U16.pack(channel) + mcap.U32.pack(len(content)) + content
            self._put(mcap.record(mcap.MESSAGE_INDEX, index))
        numbers = (*times, start, length)
        self._chunks.append(
            mcap.record(
                mcap.CHUNK_INDEX,
                b''.join(map(mcap.U64.pack, numbers))
                + mcap.U32.pack(len(offsets))
                + offsets
                + mcap.U64.pack(self._at - start - length)
                + mcap.text('')
                + mcap.U64.pack(len(data)) * 2,
            )
        )
        self.start, self.end = min(self.start, self._first), max(self.end, self._last)
        self._begin()

    def close(self) -> None:
        """Write the rest, and the summary by which readers find the parts of the file."""
        self._end_chunk()
        self._put(mcap.record(mcap.DATA_END, mcap.U32.pack(0)))
        start, offsets, summary = self._at, b'', b''
        groups = {
            mcap.SCHEMA: [*self._schemas.values()],
            mcap.CHANNEL: self._channels,
            mcap.STATISTICS: [self._statistics()],
            mcap.CHUNK_INDEX: self._chunks,
        }
        for kind, records in groups.items():
            group = b''.join(records)
            if group:
                where = mcap.U64.pack(start + len(summary)) + mcap.U64.pack(len(group))
                offsets += mcap.record(mcap.SUMMARY_OFFSET, bytes([kind]) + where)
            summary += group
        footer = mcap.U64.pack(start) + mcap.U64.pack(start + len(summary))
        footer = mcap.RECORD.pack(mcap.FOOTER, len(footer) + 4) + footer
        whole = summary + offsets + footer
        self._put(whole + mcap.U32.pack(crc32(whole)) + mcap.MAGIC)
        self._file.close()

    def _statistics(self) -> bytes:
        counts = b''.join(
            mcap.U16.pack(channel) + mcap.U64.pack(count)
            for channel, count in enumerate(self.counts)
        )
        total = sum(self.counts)
        numbers = (len(self._channels), 0, 0, len(self._chunks))
        return mcap.record(
            mcap.STATISTICS,
            mcap.U64.pack(total)
            + mcap.U16.pack(len(self._schemas))
            + b''.join(map(mcap.U32.pack, numbers))
            + mcap.U64.pack(self.start if total else 0)
            + mcap.U64.pack(self.end)
            + mcap.U32.pack(len(counts))
            + counts,
        )
