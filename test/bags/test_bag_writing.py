# SPDX-License-Identifier: Apache-2.0
"""What is written is a recording of rosbag2, complete or not, by the reading of rosbags too."""

import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64

from kalman_ros.bags.definitions import definition
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter

#: Of the type, by which rosbags tells whether the definition is right.
HASH = 'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a'
NUMBER, ODOMETRY = 'std_msgs/msg/Float64', 'nav_msgs/msg/Odometry'


#: Serialised once: what is between its numbers may differ.
ODOMETRY_BYTES = bytes(serialize_message(Odometry()))


def messages(count):
    """Yield topic, time and bytes, not in the order of time."""
    for index in range(count):
        time = 1_000_000_000 + 10 * index - 25 * (index % 3)
        if index % 2:
            yield '/number', time, bytes(serialize_message(Float64(data=float(index))))
        else:
            yield '/odom', time, ODOMETRY_BYTES


def written(folder, count):
    writer = RecordingWriter(folder)
    qualities = [{'reliability': 'best_effort', 'durability': 'volatile', 'depth': 7}]
    writer.add('/number', NUMBER, qualities, HASH)
    writer.add('/odom', ODOMETRY)
    for topic, time, data in messages(count):
        writer.write(topic, time, data)
    return writer


def in_order(count):
    return sorted(((time, topic, data) for topic, time, data in messages(count)), key=first)


def first(message):
    return message[0]


def test_rosbags_reads_what_was_written(tmp_path):
    highlevel = pytest.importorskip('rosbags.highlevel')
    written(tmp_path / 'a', 1000).close()
    with highlevel.AnyReader([tmp_path / 'a']) as reader:
        found = [(time, c.topic, bytes(data)) for c, time, data in reader.messages()]
        counts = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
        quality = next(c for c in reader.connections if c.topic == '/number')
        offered = quality.ext.offered_qos_profiles[0]
        numbers = [c for c in reader.connections if c.topic == '/number']
        _, _, data = next(reader.messages(numbers))
        number = reader.deserialize(data, NUMBER).data
    assert sorted(found) == sorted(in_order(1000))
    assert counts == {'/number': (NUMBER, 500), '/odom': (ODOMETRY, 500)}
    assert (offered.reliability.name, offered.depth) == ('BEST_EFFORT', 7)
    assert quality.digest == HASH
    assert number == 1.0


def test_our_reader_gives_the_order_of_reception(tmp_path):
    written(tmp_path / 'a', 1000).close()
    bag = Bag(tmp_path / 'a')
    assert [message[:3] for message in bag.messages(bag.topics)] == in_order(1000)
    assert not bag.damage
    assert (bag.start, bag.end) == (in_order(1000)[0][0], in_order(1000)[-1][0])


def test_a_part_of_the_topics_and_of_the_time(tmp_path):
    written(tmp_path / 'a', 1000).close()
    part = Bag(tmp_path / 'a').messages(['/odom'], 1_000_001_000, 1_000_002_000)
    found = [message[:3] for message in part]
    wanted = [m for m in in_order(1000) if m[1] == '/odom' and 1000 <= m[0] - 10**9 <= 2000]
    assert found == wanted
    assert wanted


def test_what_was_flushed_is_read_from_a_file_that_nobody_finished(tmp_path):
    writer = written(tmp_path / 'a', 600)
    writer.flush()
    for topic, time, data in messages(100):
        writer.write(topic, time, data)  # not flushed
    bag = Bag(tmp_path / 'a')
    assert [message[:3] for message in bag.messages(bag.topics)] == in_order(600)
    assert 'not finished' in bag.damage[0]
    assert bag.topics == {'/number': {NUMBER}, '/odom': {ODOMETRY}}


def test_the_metadata_are_there_from_the_start_and_kept_current(tmp_path):
    yaml = pytest.importorskip('yaml')
    writer = written(tmp_path / 'a', 600)
    path = tmp_path / 'a' / 'metadata.yaml'
    count = lambda: yaml.safe_load(path.read_text())['rosbag2_bagfile_information']  # noqa: E731
    assert count()['message_count'] == 0
    writer.flush()
    assert count()['message_count'] == 600
    assert [t['topic_metadata']['name'] for t in count()['topics_with_message_count']] == [
        '/number',
        '/odom',
    ]
    writer.close()
    assert count()['duration']['nanoseconds'] == in_order(600)[-1][0] - in_order(600)[0][0]


def test_the_metadata_are_written_once_for_many_topics(tmp_path, monkeypatch):
    written_out = []
    monkeypatch.setattr(RecordingWriter, '_describe', lambda writer: written_out.append(1))
    with RecordingWriter(tmp_path / 'a') as writer:
        for number in range(1000):
            writer.add(f'/t{number}', 'std_msgs/msg/Header')
    assert len(written_out) < 5


def test_a_folder_with_anything_else_in_it_is_refused(tmp_path):
    written(tmp_path / 'a', 10).close()
    with pytest.raises(ValueError, match='is not empty: expected a new folder'):
        RecordingWriter(tmp_path / 'a')
    RecordingWriter(tmp_path / 'a', replace=True).close()
    (tmp_path / 'a' / 'thesis.txt').write_text('mine')
    with pytest.raises(ValueError, match='is not empty'):
        RecordingWriter(tmp_path / 'a', replace=True)
    assert (tmp_path / 'a' / 'thesis.txt').read_text() == 'mine'
    with pytest.raises(ValueError, match='cannot make'):
        RecordingWriter(tmp_path / 'a' / 'thesis.txt' / 'b')


def test_a_definition_has_those_that_it_uses():
    text = definition(ODOMETRY)
    for name in ('std_msgs/Header', 'builtin_interfaces/Time', 'geometry_msgs/Quaternion'):
        assert f'\n{"=" * 80}\nMSG: {name}\n' in text
    assert definition('no_such/msg/Thing') == definition('../../etc/msg/passwd') == ''
