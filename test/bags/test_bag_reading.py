# SPDX-License-Identifier: Apache-2.0
"""Recordings of others are read; what is no recording is refused in one line."""

import bz2
import os
import sqlite3
import struct
import sys
import tracemalloc

import numpy as np
import pytest
from recorded import data

pytest.importorskip('rclpy')
pytest.importorskip('rosbags')

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kalman_ros.bags import blocks, ros1_reader
from kalman_ros.bags.blocks import Block, Message, Messages, as_published, in_order
from kalman_ros.bags.budget import Budget
from kalman_ros.bags.compression import Part, expand
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import decode, message_type

NUMBER = 'std_msgs/msg/Float64'
TYPES = get_typestore(Stores.ROS2_JAZZY)
MESSAGES = [(k % 3, 10**9 + 1000 * k - 1500 * (k % 2), float(k)) for k in range(5000)]


def serialised(value):
    return bytes(TYPES.serialize_cdr(TYPES.types[NUMBER](value), NUMBER))


def rosbag2_folder(path, storage, compression=None):
    """Write a recording by rosbags and return its path."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if compression:
        mode = rosbag2.CompressionMode[compression]
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        topics = [writer.add_connection(f'/t{k}', NUMBER, typestore=TYPES) for k in range(3)]
        for k, time, value in MESSAGES:
            writer.write(topics[k], time, serialised(value))
    return path


def expected(topics=(0, 1, 2)):
    return sorted(
        (time, f'/t{k}', serialised(value)) for k, time, value in MESSAGES if k in topics
    )


@pytest.mark.parametrize(
    ('storage', 'compression'), [('MCAP', None), ('MCAP', 'STORAGE'), ('SQLITE3', None)]
)
def test_rosbag2_is_read_in_the_order_of_reception(tmp_path, storage, compression):
    bag = Bag(rosbag2_folder(tmp_path / 'a', storage, compression))
    found = list(bag.messages(bag.topics))
    assert sorted(m[:3] for m in found) == expected()
    assert [m.time for m in found] == sorted(m.time for m in found)
    assert sorted(m[:3] for m in bag.messages(['/t1'])) == expected((1,))
    assert bag.topics == {f'/t{k}': {NUMBER} for k in range(3)}


def test_a_recording_without_metadata_and_one_in_parts(tmp_path):
    for index, part in enumerate((MESSAGES[::2], MESSAGES[1::2])):
        with RecordingWriter(tmp_path / f'part{index}') as writer:
            for k in range(3):
                writer.add(f'/t{k}', NUMBER)
            for k, time, value in part:
                writer.write(f'/t{k}', time, serialised(value))
    whole = tmp_path / 'whole'
    whole.mkdir()
    for file in tmp_path.glob('part*/*.mcap'):
        file.rename(whole / file.name)
    assert sorted(m[:3] for m in Bag(whole).messages(Bag(whole).topics)) == expected()


def ros1_bag(path, compression):
    """Write a bag of ROS 1 by rosbags and return its path."""
    types = get_typestore(Stores.ROS1_NOETIC)
    Imu, Header = types.types['sensor_msgs/msg/Imu'], types.types['std_msgs/msg/Header']
    Time, Vector = (
        types.types['builtin_interfaces/msg/Time'],
        types.types['geometry_msgs/msg/Vector3'],
    )
    Quaternion = types.types['geometry_msgs/msg/Quaternion']
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        topic = writer.add_connection('/imu', 'sensor_msgs/msg/Imu', typestore=types)
        for k in range(300):
            nine = np.arange(9.0) + k
            message = Imu(
                Header(k, Time(k, 5), 'imu'), Quaternion(0.0, 0.0, 0.0, 1.0), nine,
                Vector(1.0, 2.0, float(k)), nine, Vector(0.0, 0.0, 9.8), nine,
            )  # fmt: skip
            data = types.serialize_ros1(message, 'sensor_msgs/msg/Imu')
            writer.write(topic, 10**9 + k * 10**7, data)
    return path


@pytest.mark.parametrize('compression', [None, 'BZ2', 'LZ4'])
def test_ros_1_is_read_as_ros_2(tmp_path, compression):
    bag = Bag(ros1_bag(tmp_path / 'a.bag', compression))
    assert bag.topics == {'/imu': {'sensor_msgs/msg/Imu'}}
    found = list(bag.messages(['/imu']))
    assert [message.time for message in found] == [10**9 + k * 10**7 for k in range(300)]
    kind = message_type('sensor_msgs/Imu')
    for k in (0, 299):
        imu = decode(found[k].data, kind)
        assert (imu.header.stamp.sec, imu.header.stamp.nanosec) == (k, 5)
        assert imu.header.frame_id == 'imu'
        assert imu.angular_velocity.z == k
        np.testing.assert_array_equal(imu.linear_acceleration_covariance, np.arange(9.0) + k)


def test_a_type_of_which_ros_2_has_none_leaves_the_others(tmp_path):
    types = get_typestore(Stores.ROS1_NOETIC)
    types.register(get_types_from_msg('float64 x', 'driver/msg/Own'))
    with rosbag1.Writer(tmp_path / 'a.bag') as writer:
        for topic, kind in (('/own', 'driver/msg/Own'), ('/number', 'std_msgs/msg/Float64')):
            connection = writer.add_connection(topic, kind, typestore=types)
            data = types.serialize_ros1(types.types[kind](2.5), kind)
            writer.write(connection, 10**9, data)
    bag = Bag(tmp_path / 'a.bag')
    assert bag.topics['/own'] == {'driver/msg/Own'}
    assert bag.damage[0].endswith('no message of ROS 2 is known for driver/msg/Own')
    found = {message.topic: message.data for message in bag.messages(bag.topics)}
    assert found['/own'] == b''
    assert decode(found['/number'], message_type('std_msgs/Float64')).data == 2.5


def test_without_rosbags_a_line_says_what_to_install(tmp_path, monkeypatch):
    path = ros1_bag(tmp_path / 'a.bag', None)
    monkeypatch.setitem(sys.modules, 'rosbags.typesys', None)
    ros1_reader._types.cache_clear()
    assert refusal(path).endswith('rosbags is not installed: python3 -m pip install rosbags')
    with RecordingWriter(tmp_path / 'b') as writer:  # a recording of ours needs none of it
        writer.add('/t', NUMBER)
        writer.write('/t', 1, serialised(1.0))
    assert len(list(Bag(tmp_path / 'b').messages(['/t']))) == 1


def test_a_robot_s_bag_of_ros_1(monkeypatch):
    monkeypatch.delitem(sys.modules, 'rosbags.usertypes', raising=False)
    bag = Bag(data('diff_drive_61s.bag'))
    counts = dict.fromkeys(bag.topics, 0)
    times = []
    for message in bag.messages(bag.topics):
        counts[message.topic] += 1
        times.append(message.time)
    assert counts == {'/imu/data': 3061, '/jackal_velocity_controller/odom': 3060}
    assert times == sorted(times)
    assert 'rosbags.usertypes' not in sys.modules  # which is where definitions become code


def test_no_more_than_what_overlaps_is_in_memory():
    made = []

    def block(start):
        def read(topics, budget):
            made.append(start)
            return [Messages.of(Message(start + k, '/t', bytes(8)) for k in range(10))]

        return Block(start, start + 9, read)

    stream = in_order([block(k * 10) for k in range(100)], {'/t'}, Budget(0))
    taken = [len(next(stream)) for _ in range(3)]
    assert taken == [10, 10, 10]
    assert len(made) <= 4
    assert sum(map(len, stream)) == 970


def test_messages_of_one_time_are_in_the_order_of_the_file_and_limits_are_part_of_a_part():
    def block(content, *times):
        messages = Messages.of(Message(time, '/t', content) for time in times)
        return Block(times[0], times[-1], lambda topics, budget: [messages])

    overlapping = [block(b'a', 0, 5, 9), block(b'b', 5, 9, 10), block(b'c', 5, 6)]
    batches = in_order(overlapping, {'/t'}, Budget(0), 5, 9)
    found = [(message.time, message.data) for batch in batches for message in batch]
    assert found == [(5, b'a'), (5, b'b'), (5, b'c'), (6, b'c'), (9, b'a'), (9, b'b')]


@pytest.mark.slow
def test_a_response_that_was_received_first_is_not_before_its_cause():
    received = [(10, 5), (11, 9), (12, 7), (10**10, 10**10), (10**10 + 1, None)]
    stream = [Message(time, '/t', b'', published) for time, published in received]
    found = [message.published or message.time for message in as_published(stream)]
    assert found == [5, 7, 9, 10**10, 10**10 + 1]
    late = (Message(10 * k, '/t', b'', 2**63) for k in range(60_000))
    assert len(list(as_published(late))) == 60_000


@pytest.mark.parametrize(
    ('every', 'size', 'count'),
    [
        (2 * 10**9, 0, 3),  # of times 0, 2 and 4 s: two seconds are not more than two seconds
        (10**6, 0, 6),
        (10**6, 20, 6),
        (10**6, 50, 3),
        (10**6, 101, 1),
    ],
)
def test_a_message_waits_for_two_seconds_or_until_too_much_waits(monkeypatch, every, size, count):
    monkeypatch.setattr(blocks, 'MOST_WAITING', 5)
    monkeypatch.setattr(blocks, 'MOST_PENDING', 100)
    received = []

    def reception():
        for k in range(10):
            received.append(k)
            yield Message(every * k, '/t', bytes(size))

    stream = as_published(reception())
    assert next(stream).time == 0
    assert len(received) == count
    assert len([*stream]) == 9
    assert len(received) == 10


# --- what is no recording ------------------------------------------------------------------------


def refusal(path):
    """Return why a recording cannot be read, in one line."""
    with pytest.raises(ValueError, match=r'.') as caught:
        bag = Bag(path)
        list(bag.messages(bag.topics))
    assert '\n' not in str(caught.value)
    return str(caught.value)


def test_names_that_a_terminal_would_obey_are_not_used(tmp_path):
    hostile = '/po\x1b]0;title\x07'
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/good', 'some\x1b[31m/msg/Type')
        writer.add(hostile, NUMBER)
        for topic in ('/good', hostile):
            writer.write(topic, 1, serialised(1.0))
    bag = Bag(tmp_path / 'bag')
    assert list(bag.topics) == ['/good']
    assert bag.topics['/good'] == {'some\\x1b[31m/msg/Type'}
    assert bag.damage[0].endswith('no name of a topic: /po\\x1b]0;title\\x07')


def test_what_is_missing_empty_or_something_else(tmp_path):
    assert 'there is no recording' in refusal(tmp_path / 'no')
    assert 'no .mcap, .db3, .bag file is in it' in refusal(tmp_path)
    (tmp_path / 'a.txt').write_text('hello')
    assert 'expected a folder of rosbag2, or a file' in refusal(tmp_path / 'a.txt')
    for name in ('a.mcap', 'a.db3', 'a.bag'):
        (tmp_path / name).write_bytes(b'')
        assert name in refusal(tmp_path / name)
        (tmp_path / name).write_bytes(b'no recording at all' * 10)
        assert 'expected' in refusal(tmp_path / name)
    (tmp_path / 'a.mcap').write_bytes(b'\x89MCAP0\r\n' + bytes(20))
    assert 'no messages; ' in refusal(tmp_path / 'a.mcap')
    assert 'it was not finished' in refusal(tmp_path / 'a.mcap')
    RecordingWriter(tmp_path / 'empty').close()
    assert 'is an empty recording' in refusal(tmp_path / 'empty')
    (tmp_path / 'z').mkdir()
    (tmp_path / 'z' / 'a.mcap.zstd').write_bytes(b'x')
    assert 'unzstd its files first' in refusal(tmp_path / 'z')


def test_a_view_in_the_place_of_the_messages_is_not_asked(tmp_path):
    file = sqlite3.connect(tmp_path / 'a.db3')
    file.execute('CREATE TABLE topics (id, name, type, serialization_format)')
    endless = 'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)'
    file.execute(
        f'CREATE VIEW messages AS {endless} SELECT i AS id, 1 AS topic_id, i AS timestamp, '
        "'' AS data FROM n"
    )
    file.commit()
    file.close()
    assert 'without messages' in refusal(tmp_path / 'a.db3')


@pytest.mark.parametrize('data', [None, 2**40, 'text'])
def test_what_is_no_bytes_is_not_taken_for_a_message(tmp_path, data):
    """A number would be taken for how many bytes to make."""
    file = sqlite3.connect(tmp_path / 'a.db3')
    file.execute('CREATE TABLE topics (id, name, type, serialization_format)')
    file.execute('CREATE TABLE messages (id, topic_id, timestamp, data)')
    file.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/Float64', 'cdr')")
    file.execute('INSERT INTO messages VALUES (1, 1, 5, ?)', (data,))
    file.commit()
    file.close()
    with pytest.raises(ValueError, match='1 messages without a time or without bytes'):
        list(Bag(tmp_path / 'a.db3').messages(['/a']))


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / 'a.mcap')
    assert 'is not a file' in refusal(tmp_path / 'a.mcap')
    assert 'is not a file' in refusal(tmp_path)


def test_a_chunk_that_lies_about_its_time_is_damaged(tmp_path):
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/good', NUMBER)
        writer.write('/good', 1_000, serialised(1.0))
    [file] = (tmp_path / 'bag').glob('*.mcap')
    data = bytearray(file.read_bytes())
    at = 8
    while data[at] != 6:  # up to the chunk
        at += 9 + struct.unpack_from('<Q', data, at + 1)[0]
    struct.pack_into('<QQ', data, at + 9, 2**64 - 1, 2**64 - 1)
    file.write_bytes(data)
    with pytest.raises(ValueError, match='not received when'):
        list(Bag(file).messages(['/good']))


@pytest.mark.slow
def test_sizes_are_checked_before_memory_is_taken(tmp_path):
    huge = 2**40
    head = b'\x89MCAP0\r\n' + struct.pack('<BQ', 1, 8) + bytes(8)
    chunk = struct.pack('<QQQI', 0, 1, huge, 0) + struct.pack('<I', 0) + struct.pack('<Q', 4)
    lies = head + struct.pack('<BQ', 6, len(chunk) + 4) + chunk + b'1234'
    (tmp_path / 'a.mcap').write_bytes(lies)
    tracemalloc.start()
    try:
        assert 'a part of 1099511627776 bytes' in refusal(tmp_path / 'a.mcap')
        with pytest.raises(ValueError, match='a part of 1099511627776 bytes'):
            Part(0, huge, '', 1).read(tmp_path / 'a.mcap', Budget(0))
        bomb = bz2.compress(bytes(100_000_000))
        with pytest.raises(ValueError, match='a block has 1001 bytes, expected 1000'):
            expand(bomb, 'bz2', 1000)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2.1e8  # what was compressed here, and little more


@pytest.fixture(scope='module')
def samples(tmp_path_factory):
    """Return the bytes of small recordings, by the end of their names."""
    folder = tmp_path_factory.mktemp('samples')
    with RecordingWriter(folder / 'a') as writer:
        writer.add('/t0', NUMBER)
        for k, (_, time, value) in enumerate(MESSAGES[:200]):
            writer.write('/t0', time, serialised(value))
            if k % 50 == 0:
                writer.flush()
    ros1_bag(folder / 'b.bag', None)
    rosbag2_folder(folder / 'c', 'SQLITE3')
    rosbag2_folder(folder / 'd', 'MCAP', 'STORAGE')
    return [
        ('.mcap', next((folder / 'a').glob('*.mcap')).read_bytes()),
        ('.bag', (folder / 'b.bag').read_bytes()),
        ('.db3', next((folder / 'c').glob('*.db3')).read_bytes()),
        ('.mcap', next((folder / 'd').glob('*.mcap')).read_bytes()),
    ]


#: Each example writes a file.
FILES = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=settings.default.max_examples // 4,
)


def consume(path):
    """Read a recording; return what is refused."""
    try:
        bag = Bag(path)
        for message in bag.messages(bag.topics):
            assert isinstance(message.data, bytes)
    except ValueError as error:
        assert '\n' not in str(error)
        return str(error)
    return ''


@pytest.mark.slow
@FILES
@given(which=st.integers(0, 3), share=st.floats(0.0, 1.0))
def test_a_truncated_recording_is_read_as_far_as_it_goes_or_refused(
    samples, tmp_path, which, share
):
    end, whole = samples[which]
    path = tmp_path / f'a{end}'
    path.write_bytes(whole[: int(share * len(whole))])
    consume(path)


@pytest.mark.slow
@FILES
@given(
    which=st.integers(0, 3),
    edits=st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=9)), max_size=6),
)
def test_any_bytes_give_messages_or_one_line(samples, tmp_path, which, edits):
    end, whole = samples[which]
    broken = bytearray(whole)
    for share, patch in edits:
        at = int(share * (len(whole) - len(patch)))
        broken[at : at + len(patch)] = patch
    path = tmp_path / f'a{end}'
    path.write_bytes(broken)
    consume(path)


def test_half_a_recording_has_the_messages_of_its_complete_chunks(samples, tmp_path):
    _, whole = samples[0]
    path = tmp_path / 'a.mcap'
    path.write_bytes(whole[: len(whole) // 2])
    bag = Bag(path)
    assert 0 < len(list(bag.messages(bag.topics))) < 200
    assert 'not finished' in bag.damage[0]
