# SPDX-License-Identifier: Apache-2.0
"""The records of MCAP files (https://mcap.dev/spec), as bytes and from bytes."""

from __future__ import annotations

from struct import Struct, error
from typing import NamedTuple

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, SUMMARY_OFFSET, DATA_END = 0x0B, 0x0E, 0x0F

#: Start of a record: its kind, and the length of the rest.
RECORD = Struct('<BQ')
#: Start of a message: also channel, number, and times of reception and publication in ns.
MESSAGE_RECORD = Struct('<BQHIQQ')
MESSAGE_FIELDS = Struct('<HIQQ')
#: Start of a chunk: the first and the last time, the size and the CRC of its content.
CHUNK_FIELDS = Struct('<QQQI')
U16, U32, U64 = Struct('<H'), Struct('<I'), Struct('<Q')


def record(kind: int, content: bytes) -> bytes:
    """Return a record."""
    return RECORD.pack(kind, len(content)) + content


def text(value: str) -> bytes:
    """Return a text, preceded by its length."""
    data = value.encode()
    return U32.pack(len(data)) + data


def schema(number: int, name: str, definition: str) -> bytes:
    """Return the record of a message type."""
    encoding = 'ros2msg' if definition else ''
    return record(SCHEMA, U16.pack(number) + text(name) + text(encoding) + text(definition))


def channel(number: int, schema_number: int, topic: str, metadata: dict[str, str]) -> bytes:
    """Return the record of a topic."""
    pairs = b''.join(text(key) + text(value) for key, value in metadata.items())
    start = U16.pack(number) + U16.pack(schema_number) + text(topic) + text('cdr')
    return record(CHANNEL, start + U32.pack(len(pairs)) + pairs)


class Channel(NamedTuple):
    """A topic of a file."""

    schema: int
    topic: str
    encoding: str


class Fields:
    """Reader of the fields of a record, one by one; ValueError if the record is too short."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def number(self, kind: Struct) -> int:
        """Return the next number."""
        try:
            (value,) = kind.unpack_from(self._data, self._at)
        except error:
            raise ValueError('a record is too short') from None
        self._at += kind.size
        return int(value)

    def text(self) -> str:
        """Return the next text."""
        size = self.number(U32)
        if size > len(self._data) - self._at:
            raise ValueError('a text is longer than its record')
        start, self._at = self._at, self._at + size
        return self._data[start : self._at].decode(errors='replace')


def read_schema(data: bytes) -> tuple[int, str]:
    """Return the number and the name of a message type."""
    fields = Fields(data)
    return fields.number(U16), fields.text()


def read_channel(data: bytes) -> tuple[int, Channel]:
    """Return the number of a topic, and the topic."""
    fields = Fields(data)
    number, schema_number = fields.number(U16), fields.number(U16)
    return number, Channel(schema_number, fields.text(), fields.text())
