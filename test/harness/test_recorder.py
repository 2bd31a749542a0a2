# SPDX-License-Identifier: Apache-2.0
"""A recorder keeps every message, and writes it to a recording only where there is one."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from std_msgs.msg import Float64

from kalman_ros.bags.reading import Bag
from kalman_ros.core import Signal
from kalman_ros.harness.recorder import Recorder
from kalman_ros.harness.run_recording import RunRecording
from kalman_ros.pipeline.intake import Intake


class Node:
    """Hands what is sent to the callbacks of those who watch."""

    def __init__(self):
        self.intake, self.times, self._callbacks = Intake(print), (7, 5), {}

    def resolve_topic_name(self, topic):
        return f'/{topic}'

    def watch(self, kind, topic, callback, queue):
        self._callbacks[topic] = callback
        return SimpleNamespace(topic_name=f'/{topic}', msg_type=kind)

    def send(self, topic, value):
        self._callbacks[topic](bytes(serialize_message(Float64(data=value))))


@pytest.fixture
def recorder():
    """A recorder of two numbers."""
    node = Node()
    signals = {name: Signal(name, 'std_msgs/Float64', ('data',)) for name in ('a', 'b')}
    return node, Recorder(node, signals)


def test_messages_are_kept_and_counted_without_a_recording(recorder):
    node, found = recorder
    noted = []
    found.on_message = lambda topic, data: noted.append(topic)
    for value in (1.0, 2.0, 3.0):
        node.send('a', value)
    assert found['a'].values.tolist() == [[1.0], [2.0], [3.0]]
    assert len(found['b'].values) == 0
    assert found.received == {'/a': 3, '/b': 0}
    assert found.missing({'/a': 4, '/b': 0}) == {'/a': (3, 4)}
    assert noted == ['a', 'a', 'a']


def test_from_then_on_they_are_written_too(recorder, tmp_path):
    node, found = recorder
    node.send('a', 1.0)
    recording = RunRecording(node, tmp_path)
    found.write_to(recording)
    node.send('a', 2.0)
    node.send('b', 3.0)
    recording.close()
    written = [(m.topic, m.data) for m in Bag(tmp_path).messages({'/a', '/b'})]
    assert written == [('/a', found.raw['a'][1]), ('/b', found.raw['b'][0])]
    assert found.received == {'/a': 2, '/b': 1}
