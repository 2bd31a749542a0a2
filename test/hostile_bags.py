# SPDX-License-Identifier: Apache-2.0
"""Recordings that are small on disk and ask for much memory or time."""

import sqlite3
import struct
from contextlib import closing
from zlib import crc32

from kalman_ros.bags import mcap

NUMBER = 'std_msgs/msg/Float64'


# --- MCAP ----------------------------------------------------------------------------------------


def empty_messages(count, first=0, step=1):
    """Return the records of messages without content, on the first topic."""
    size, pack = mcap.MESSAGE_FIELDS.size, mcap.MESSAGE_RECORD.pack
    if not step:
        return pack(mcap.MESSAGE, size, 0, 0, first, first) * count
    times = range(first, first + count * step, step)
    return b''.join(pack(mcap.MESSAGE, size, 0, k, time, time) for k, time in enumerate(times))


def zstd(content):
    """Return content as compressed by zstd."""
    try:
        from compression.zstd import compress  # Python 3.14
    except ModuleNotFoundError:
        from backports.zstd import compress
    return compress(content)


def chunk(content, start, end, *, stored=None, size=None, crc=None):
    """Return the record of a chunk, compressed if its stored bytes are given."""
    kind, stored = ('', content) if stored is None else ('zstd', stored)
    size, crc = len(content) if size is None else size, crc32(content) if crc is None else crc
    fields = mcap.CHUNK_FIELDS.pack(start, end, size, crc) + mcap.text(kind)
    return mcap.record(mcap.CHUNK, fields + mcap.U64.pack(len(stored)) + stored)


def write_mcap(path, chunks, topics=('/t',)):
    """Write an MCAP file of chunks and return its path."""
    with path.open('wb') as file:
        file.write(mcap.MAGIC + mcap.record(mcap.HEADER, mcap.text('ros2') + mcap.text('')))
        file.write(mcap.schema(1, NUMBER, ''))
        file.writelines(mcap.channel(k, 1, topic, {}) for k, topic in enumerate(topics))
        file.writelines(chunks)
        file.write(mcap.record(mcap.DATA_END, bytes(4)) + mcap.record(mcap.FOOTER, bytes(20)))
        file.write(mcap.MAGIC)
    return path


def overlapping(path, chunks, count):
    """Write chunks, each with ``count`` empty messages from 0 to 1000 ns, compressed."""
    content = empty_messages(1, 0) + empty_messages(count - 1, 1000, 0)
    one = chunk(content, 0, 1000, stored=zstd(content))
    return write_mcap(path, [one] * chunks)


def spread(path, chunks):
    """Write chunks of two messages that begin one after the other, and all end together."""
    size, pack = mcap.MESSAGE_FIELDS.size, mcap.MESSAGE_RECORD.pack
    last = pack(mcap.MESSAGE, size, 0, 0, chunks, chunks)
    return write_mcap(path, (chunk(empty_messages(1, k) + last, k, chunks) for k in range(chunks)))


# --- SQLite --------------------------------------------------------------------------------------

#: An expression that keeps its reader busy.
BUSY = "length(replace(hex(zeroblob(20000000)), '0', '00'))"


def write_sqlite(path, rows, *statements, index=True):
    """Write an SQLite file of rosbag2 with (topic, time, data) in rows, and return its path.

    The statements are executed last.
    """
    with closing(sqlite3.connect(path)) as file:
        file.execute(
            'CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)'
        )
        file.execute('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)')
        file.execute('INSERT INTO topics VALUES (1, ?, ?, ?)', ('/t', NUMBER, 'cdr'))
        file.executemany('INSERT INTO messages VALUES (NULL, ?, ?, ?)', rows)
        if index:
            file.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
        for statement in statements:
            file.execute(statement)
        file.commit()
    return path


def generated(column, expression):
    """Return the statements that make a column of the messages a generated one."""
    return (
        'DROP INDEX timestamp_idx',
        f'ALTER TABLE messages DROP COLUMN {column}',
        f'ALTER TABLE messages ADD COLUMN {column} AS ({expression})',
    )


# --- ROS 1 ---------------------------------------------------------------------------------------


def ros1_record(fields, data):
    """Return a record with the fields of its head, and its data."""
    head = b''.join(
        struct.pack('<I', len(name) + 1 + len(value)) + name + b'=' + value
        for name, value in fields.items()
    )
    return struct.pack('<I', len(head)) + head + struct.pack('<I', len(data)) + data


def _ros1_chunk(size):
    return {b'op': b'\x05', b'compression': b'none', b'size': struct.pack('<I', size)}


def write_ros1(path, content, size=None):
    """Write a bag of ROS 1 with a chunk that says to have a size, and return its path."""
    fields = _ros1_chunk(len(content) if size is None else size)
    path.write_bytes(b'#ROSBAG V2.0\n' + ros1_record(fields, content))
    return path


def write_sparse_ros1(path, size):
    """Write a bag of ROS 1 with a chunk of ``size`` zeros, which are a hole in the file."""
    head = ros1_record(_ros1_chunk(size), b'')[:-4] + struct.pack('<I', size)
    with path.open('wb') as file:
        file.write(b'#ROSBAG V2.0\n' + head)
        file.truncate(file.tell() + size)
    return path
