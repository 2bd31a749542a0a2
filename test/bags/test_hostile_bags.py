# SPDX-License-Identifier: Apache-2.0
"""Recordings that ask for much memory or time, or are damaged, are refused in one line."""

import bz2
import os
import signal
import sqlite3
import struct
import tracemalloc
from contextlib import closing, contextmanager
from types import SimpleNamespace

import pytest
from thorough import mostly_thorough, thorough

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

import hostile_bags as hostile

from kalman_ros.bags import budget, compression, mcap, sqlite_reader
from kalman_ros.bags.blocks import Block, Message, Messages, in_order
from kalman_ros.bags.budget import Budget
from kalman_ros.bags.compression import expand
from kalman_ros.bags.reading import Bag, _on_disk
from kalman_ros.bags.sqlite_reader import SqliteFile


def count(path):
    """Return the number of messages of a recording."""
    bag = Bag(path)
    return sum(1 for _ in bag.messages(bag.topics))


@contextmanager
def refused(match, peak=None):
    """Expect a refusal in one line, before more than ``peak`` bytes were in memory."""
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=match) as caught:
            yield
        reached = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert '\n' not in str(caught.value)
    if peak is not None:
        assert reached < peak


# --- the budget ----------------------------------------------------------------------------------


def test_hours_of_a_robot_are_far_below_all_limits():
    """A hundred million messages in 100 GB, in chunks of 768 kB that are compressed to a third."""
    disk, parts = 35 * 10**9, 130_000
    opening, reading = Budget(disk), Budget(disk)
    for _ in range(parts):
        opening.note()
        opening.work(30)
        reading.expand(260_000, 768_000)
        reading.work(770)
        reading.hold(10 * 768_000)
        reading.release(10 * 768_000)


@pytest.mark.parametrize(
    ('ask', 'most', 'match'),
    [
        (lambda b, n: b.expand(0, n), 1 << 28, 'a part of 268435457 bytes, more than 268435456'),
        (lambda b, n: b.expand(n, 0), 1 << 28, 'a part of 268435457 bytes, more than 268435456'),
        (lambda b, n: b.hold(n), 1 << 29, 'more than 536870912 bytes are not in order'),
        (lambda b, n: b.hold((1 << 29) - 1000) or b.note('x' * n), 500, 'describe parts'),
        (lambda b, n: b.work(n), 1_000_007, 'more than 1000007 records or steps for 7 bytes'),
    ],
)
def test_what_is_allowed_and_one_more(ask, most, match):
    ask(Budget(7), most)
    with pytest.raises(ValueError, match=match):
        ask(Budget(7), most + 1)


def test_what_a_recording_may_expand_to(monkeypatch):
    monkeypatch.setattr(budget, 'FREE_BYTES', 500)
    enough = Budget(7)
    enough.expand(7, 5000)
    enough.expand(7, 2500)
    with pytest.raises(ValueError, match='7 bytes on disk expand to more than 1000 times'):
        enough.expand(0, 1)


# --- MCAP ----------------------------------------------------------------------------------------


def test_more_messages_than_a_small_file_can_have(tmp_path, monkeypatch):
    path = hostile.overlapping(tmp_path / 'a.mcap', 5, 5000)
    assert count(path) == 25_000
    monkeypatch.setattr(budget, 'FREE_RECORDS', 5000)
    with refused('records or steps for', peak=4e6):
        count(path)


@pytest.mark.slow
def test_a_hole_does_not_make_a_file_larger(tmp_path, monkeypatch):
    path = hostile.overlapping(tmp_path / 'a.mcap', 5, 5000)
    os.truncate(path, 10_000_000)
    assert count(path) == 25_000
    monkeypatch.setattr(budget, 'FREE_RECORDS', 5000)
    with refused('records or steps for'):
        count(path)


def test_where_a_file_system_does_not_count_blocks_the_length_counts():
    def file(**status):
        status = SimpleNamespace(st_dev=1, st_ino=status['st_blocks'], **status)
        return SimpleNamespace(is_file=lambda: True, stat=lambda: status, name='a')

    assert _on_disk([file(st_size=1 << 20, st_blocks=0)]) == 1 << 20
    assert _on_disk([file(st_size=1 << 20, st_blocks=8)]) == 4096
    assert _on_disk([file(st_size=100, st_blocks=8), file(st_size=50, st_blocks=16)]) == 150


def test_unwanted_messages_are_work_too(tmp_path, monkeypatch):
    path = hostile.overlapping(tmp_path / 'a.mcap', 5, 5000)
    bag = Bag(path)
    assert list(bag.messages({'/other'})) == []
    monkeypatch.setattr(budget, 'FREE_RECORDS', 5000)
    with refused('records or steps for'):
        list(bag.messages({'/other'}))


def test_parts_that_overlap_do_not_fill_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(budget, 'MOST_PENDING', 500_000)
    path = hostile.overlapping(tmp_path / 'a.mcap', 50, 300)
    with refused('bytes are not in order', peak=1e6):
        count(path)
    chunks = [
        hostile.chunk(hostile.empty_messages(300, start), start, start + 299)
        for start in range(0, 3000, 300)
    ]
    assert count(hostile.write_mcap(tmp_path / 'b.mcap', chunks)) == 3000


def test_parts_that_overlap_are_merged_without_sorting_all_again():
    class Content(bytes):
        asked = 0

        def __len__(self):
            Content.asked += 1
            return 0

    def block(start):
        def read(topics, budget):
            both = Message(300, '/t', Content()), Message(start, '/t', Content())
            return [Messages.of(both)]

        return Block(start, 300, read)

    batches = list(in_order([block(k) for k in range(300)], {'/t'}, Budget(0)))
    times = [message.time for batch in batches for message in batch]
    assert times == [*range(300), *[300] * 300]
    assert Content.asked <= 2 * len(times)


def test_many_parts_are_described_within_the_budget(tmp_path, monkeypatch):
    path = hostile.spread(tmp_path / 'a.mcap', 300)
    assert count(path) == 600
    monkeypatch.setattr(budget, 'MOST_PENDING', 300 * 500)  # and a topic
    with refused('bytes are not in order, or describe parts'):
        Bag(path)


def test_content_that_expands_too_much(tmp_path, monkeypatch):
    content = hostile.empty_messages(300_000, 1, 0)
    stored = hostile.zstd(content)
    path = hostile.write_mcap(tmp_path / 'a.mcap', [hostile.chunk(content, 1, 1, stored=stored)])
    monkeypatch.setattr(budget, 'FREE_BYTES', 0)
    with refused('bytes on disk expand to more than 1000 times', peak=1e6):
        count(path)


def test_names_in_chunks_are_kept_within_the_budget(tmp_path, monkeypatch):
    long = [mcap.channel(k, 1, f'/{k}' * 100_000, {}) for k in range(2, 8)]
    types = [mcap.schema(k, f'/{k}' * 100_000, '') for k in range(2, 8)]
    paths = []
    for names in (long, [*types, mcap.channel(1, 1, '/t', {})]):
        chunk = hostile.chunk(b''.join(names) + hostile.empty_messages(1), 0, 0)
        paths.append(hostile.write_mcap(tmp_path / f'{len(paths)}.mcap', [chunk], ()))
    assert [len(Bag(path).topics) for path in paths] == [6, 1]
    monkeypatch.setattr(budget, 'MOST_PENDING', 1_000_000)
    for path in paths:
        with refused('describe parts'):
            Bag(path)


def test_a_long_definition_in_a_chunk_is_left_out(tmp_path):
    long = mcap.channel(1, 1, '/' + 'x' * (1 << 20), {}) + mcap.channel(2, 1, '/good', {})
    chunk = hostile.chunk(long + hostile.empty_messages(1), 0, 0)
    assert [*Bag(hostile.write_mcap(tmp_path / 'a.mcap', [chunk], ())).topics] == ['/good']


def test_a_file_under_another_name_is_not_read_twice(tmp_path):
    hostile.overlapping(tmp_path / 'a.mcap', 2, 10)
    assert count(tmp_path) == 20
    for link in (os.symlink, os.link):
        link(tmp_path / 'a.mcap', tmp_path / 'b.mcap')
        with refused(r"b\.mcap' is the same file as 'a\.mcap'$"):
            Bag(tmp_path)
        (tmp_path / 'b.mcap').unlink()


@pytest.mark.parametrize('kind', ['zstd', 'bz2', 'lz4'])
def test_compressed_content_is_made_in_pieces_between_which_signals_are_handled(kind, monkeypatch):
    lz4 = pytest.importorskip('lz4.frame')
    content = os.urandom(10_000) + bytes(90_000)
    compress = {'zstd': hostile.zstd, 'bz2': bz2.compress, 'lz4': lz4.compress}[kind]
    monkeypatch.setattr(compression, '_PIECE', 999)
    sizes, make = [], compression._KINDS[kind]

    class Watched:
        def __init__(self):
            self.inner = make()

        def __getattr__(self, name):
            return getattr(self.inner, name)

        def decompress(self, data, max_length):
            sizes.append(max_length)
            return self.inner.decompress(data, max_length)

    monkeypatch.setitem(compression._KINDS, kind, Watched)
    assert expand(compress(content), kind, len(content)) == content
    assert max(sizes) == 999 and len(sizes) > 100
    with refused('a block has 100000 bytes, expected 99999'):
        expand(compress(content), kind, 99_999)
    with refused('a block has .* bytes, expected 100000|is not'):
        expand(compress(content)[:-200], kind, 100_000)


# --- the integrity of MCAP -----------------------------------------------------------------------

_CONTENT = hostile.empty_messages(3)
_LONG = mcap.MESSAGE_RECORD.pack(mcap.MESSAGE, 23, 0, 0, 0, 0)
_CHANNEL = mcap.record(mcap.CHANNEL, mcap.U16.pack(5) + mcap.U16.pack(1) + mcap.U32.pack(99))
_SHORT = mcap.record(mcap.CHANNEL, bytes(1)) + bytes(36)  # and four empty records


@pytest.mark.parametrize(
    ('record', 'match'),
    [
        (hostile.chunk(_CONTENT, 0, 2, crc=1), 'damaged: its checksum differs'),
        (hostile.chunk(_CONTENT, 0, 2, size=94), 'a block has 93 bytes, expected 94'),
        (hostile.chunk(_CONTENT, 0, 2, size=92), 'a block has 93 bytes, expected 92'),
        (hostile.chunk(_CONTENT, 1, 2), 'not received when the part'),
        (hostile.chunk(_CONTENT, 0, 1), 'not received when the part'),
        (hostile.chunk(_CONTENT + _LONG, 0, 2), 'a message is longer than its chunk'),
        (hostile.chunk(_CHANNEL + _CONTENT, 0, 2), 'a text is longer than its record'),
        (hostile.chunk(_SHORT + _CONTENT, 0, 2), 'a record is too short'),
        (mcap.record(mcap.CHUNK, bytes(10)), 'a record is too short'),
        (hostile.chunk(_CONTENT, 0, 2, stored=_CONTENT), 'a block is not zstd'),
        (
            mcap.record(mcap.CHUNK, hostile.chunk(_CONTENT, 0, 2)[9:] + b'1'),
            r'a chunk of 93 bytes in a record of 134',
        ),
        (
            mcap.record(mcap.CHUNK, hostile.chunk(_CONTENT, 0, 2)[9:-1]),
            r'a chunk of 93 bytes in a record of 132',
        ),
    ],
)
def test_a_damaged_chunk_is_refused(tmp_path, record, match):
    path = tmp_path / 'a.mcap'
    assert count(hostile.write_mcap(path, [hostile.chunk(_CONTENT, 0, 2)])) == 3
    with refused(match):
        count(hostile.write_mcap(path, [record]))


def test_a_chunk_without_a_checksum_is_read(tmp_path):
    """The format lets a writer leave it out, as 0."""
    chunk = hostile.chunk(_CONTENT, 0, 2, crc=0)
    assert count(hostile.write_mcap(tmp_path / 'a.mcap', [chunk])) == 3


@pytest.mark.parametrize('at', range(8))
def test_each_byte_of_the_magic_counts(tmp_path, at):
    path = hostile.write_mcap(tmp_path / 'a.mcap', [hostile.chunk(_CONTENT, 0, 2)])
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)
    with refused('expected an MCAP file, which this is not'):
        Bag(path)


def test_a_file_without_its_end_is_read_and_said_to_be_unfinished(tmp_path):
    path = hostile.write_mcap(tmp_path / 'a.mcap', [hostile.chunk(_CONTENT, 0, 2)] * 2)
    assert Bag(path).damage == []
    path.write_bytes(path.read_bytes()[: -8 - 29 - 13 - 1])
    assert count(path) == 3
    assert 'it was not finished' in Bag(path).damage[0]


# --- SQLite --------------------------------------------------------------------------------------

ROWS = [(1, k, b'') for k in range(3000)]


@pytest.mark.parametrize('column', ['data', 'timestamp'])
def test_columns_that_are_computed_are_not_asked(tmp_path, column):
    path = tmp_path / 'a.db3'
    hostile.write_sqlite(path, ROWS[:9], *hostile.generated(column, hostile.BUSY))
    with refused(rf'expected plain columns, messages\.{column} is generated$', peak=1e6):
        Bag(path)


def test_a_virtual_table_is_none(tmp_path):
    path = tmp_path / 'a.db3'
    with closing(sqlite3.connect(path)) as file:
        if not file.execute("SELECT 1 FROM pragma_module_list WHERE name = 'rtree'").fetchall():
            pytest.skip('this SQLite has no R-trees')
    hostile.write_sqlite(
        path, [], 'DROP TABLE messages', 'CREATE VIRTUAL TABLE messages USING rtree(a, b, c)'
    )
    with refused('expected a recording of rosbag2, without messages'):
        Bag(path)


@pytest.mark.parametrize(
    'query',
    [
        'SELECT randomblob(9) FROM messages',
        'SELECT * FROM other',
        "ATTACH 'x' AS y",
        'PRAGMA table_info(messages)',
        'DELETE FROM messages',
        'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n',
    ],
)
def test_a_query_may_do_nothing_else(tmp_path, query):
    path = hostile.write_sqlite(tmp_path / 'a.db3', ROWS, 'CREATE TABLE other (a)')
    source = SqliteFile(path, Budget(0))
    with (
        pytest.raises(sqlite3.DatabaseError, match='prohibited|not authorized'),
        source._open(Budget(0)) as file,
    ):
        file.execute(query)


@pytest.mark.slow
@pytest.mark.parametrize(
    'before',
    mostly_thorough([[5], [-(2**63)], [5, 2**63 - 1], [-(2**63), 2**63 - 1]], [5, 2**63 - 1]),
)
def test_a_message_from_before_the_clock_was_set_leaves_small_parts(tmp_path, monkeypatch, before):
    monkeypatch.setattr(sqlite_reader, '_SLICE', 10)
    times = sorted([*before, *(1_700_000_000_000_000_000 + 50_000_000 * k for k in range(2000))])
    path = hostile.write_sqlite(tmp_path / 'a.db3', [(1, time, b'x') for time in times])
    assert count(path) == len(times)
    file = SqliteFile(path, Budget(10**6))
    largest = max(sum(block.start <= time <= block.end for time in times) for block in file.blocks)
    assert largest <= 40


def test_the_steps_of_sqlite_are_work(tmp_path, monkeypatch):
    """Without an index, all rows are looked at for each slice."""
    monkeypatch.setattr(budget, 'FREE_RECORDS', 100_000)
    monkeypatch.setattr(sqlite_reader, '_STEPS', 1)
    monkeypatch.setattr(sqlite_reader, '_SLICE', 10)
    assert count(hostile.write_sqlite(tmp_path / 'a.db3', ROWS[:500])) == 500
    with refused('records or steps for'):
        count(hostile.write_sqlite(tmp_path / 'b.db3', ROWS[:500], index=False))


def test_messages_of_one_time_are_in_the_order_of_the_file(tmp_path):
    rows = [(1, 5, bytes([k])) for k in range(9)]
    path = hostile.write_sqlite(
        tmp_path / 'a.db3', rows, 'CREATE INDEX other ON messages (topic_id, timestamp, data DESC)'
    )
    assert [message.data for message in Bag(path).messages({'/t'})] == [row[2] for row in rows]


def test_a_slice_is_weighed_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(budget, 'MOST_BLOCK', 5_000_000)
    path = hostile.write_sqlite(tmp_path / 'a.db3', [(1, 0, bytes(5_000_000))])
    assert count(path) == 1
    path = hostile.write_sqlite(
        tmp_path / 'b.db3', [(1, 0, bytes(2_500_000))] * 2 + [(1, 0, b'1')]
    )
    with refused('a part of 5000001 bytes, more than 5000000', peak=1e6):
        count(path)


def test_long_names_of_topics_are_weighed_before_they_are_read(tmp_path):
    path = tmp_path / 'a.db3'
    hostile.write_sqlite(path, ROWS[:1], 'UPDATE topics SET name = hex(zeroblob(10000000))')
    with refused('topics of .* bytes, more than 16777216', peak=1e6):
        Bag(path)


@pytest.mark.parametrize('signals', [1, thorough(1000)])
def test_a_signal_ends_a_query(tmp_path, signals):
    """At whatever moment while it runs. While it is prepared, SQLite drops what is raised."""

    class StopError(Exception):
        pass

    def on_signal(*_):
        raise StopError

    source = SqliteFile(hostile.write_sqlite(tmp_path / 'a.db3', ROWS), Budget(0))
    before = signal.signal(signal.SIGALRM, on_signal)
    try:
        for number in range(signals):
            with pytest.raises(StopError), source._open(Budget(10**15)) as file:
                signal.setitimer(signal.ITIMER_REAL, 0.02 + 1e-6 * number)
                file.execute('SELECT sum(a.id) FROM messages a, messages b, messages c').fetchall()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


# --- ROS 1 ---------------------------------------------------------------------------------------


def test_a_hole_in_the_file_is_not_read(tmp_path):
    path = hostile.write_sparse_ros1(tmp_path / 'a.bag', 2**32 - 1)
    assert path.stat().st_blocks < 100
    with refused('a part of 4294967295 bytes, more than 268435456', peak=1e6):
        count(path)


TIME = struct.pack('<II', 1, 5)
MESSAGE = {b'op': b'\x02', b'conn': bytes(4), b'time': TIME}
CONNECTION = {b'op': b'\x07', b'conn': bytes(4), b'topic': b'/t'}


def ros1_content(*records):
    """Return records (fields, data) one after the other, with a connection first."""
    first = hostile.ros1_record(CONNECTION, b'\x15\0\0\0type=std_msgs/Float64')
    return first + b''.join(hostile.ros1_record(*record) for record in records)


VALUE = struct.pack('<d', 1.0)
GOOD = MESSAGE, VALUE


@pytest.mark.parametrize(
    ('content', 'match'),
    [
        (ros1_content(GOOD)[:-1], 'a record is longer than its chunk'),
        (ros1_content(GOOD) + struct.pack('<II', 9, 0), 'a record is longer than its chunk'),
        (ros1_content(({b'op': b'\x02', b'time': TIME}, VALUE)), 'a record without conn'),
        (ros1_content(({b'op': b'\x02', b'conn': bytes(4)}, VALUE)), 'a record without a time'),
        (ros1_content(({b'x': bytes(1 << 16)}, b''), GOOD), 'a record with a head of 65542 bytes'),
        (
            ros1_content(({b'%d' % k: b'' for k in range(102)}, b''), GOOD),
            'a record with more than 100 fields',
        ),
    ],
)
def test_a_damaged_chunk_of_ros_1_is_refused(tmp_path, content, match):
    path = tmp_path / 'a.bag'
    assert count(hostile.write_ros1(path, ros1_content(GOOD))) == 1
    with refused(match):
        count(hostile.write_ros1(path, content))


@pytest.mark.parametrize('change', [-1, 1])
def test_a_chunk_of_ros_1_has_the_size_that_it_says(tmp_path, change):
    content = ros1_content(GOOD)
    size = len(content) + change
    with refused(f'a block has {len(content)} bytes, expected {size}'):
        count(hostile.write_ros1(tmp_path / 'a.bag', content, size))


def test_records_of_ros_1_are_work(tmp_path, monkeypatch):
    path = hostile.write_ros1(tmp_path / 'a.bag', ros1_content(*[GOOD] * 500))
    assert count(path) == 500
    monkeypatch.setattr(budget, 'FREE_RECORDS', -path.stat().st_size + 600)
    with refused('records or steps for'):
        count(path)
