# SPDX-License-Identifier: Apache-2.0
"""The real nodes behind the server for viewers: what a client of the protocol sees and changes."""

import json
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import threading
import time

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('foxglove')
pytest.importorskip('websockets')

import rclpy
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64
from websockets.sync.client import connect

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import decode, message_type
from kalman_ros.harness import executables
from kalman_ros.harness.domain import Domain

pytestmark = pytest.mark.real_time


def free_port():
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]


class View:
    """A running view and one viewer of it."""

    def __init__(self, *arguments):
        self.port = free_port()
        command = [str(executables.executable('view')), '--port', str(self.port), *arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        self.channels, self.output = {}, ''

    def __enter__(self):
        while f'127.0.0.1:{self.port}/' not in self.output:
            line = self.process.stdout.readline()
            assert line, self.output
            self.output += line
        self.viewer = self.connect()
        return self

    def connect(self):
        return connect(
            f'ws://127.0.0.1:{self.port}', subprotocols=['foxglove.sdk.v1'], max_size=None,
            max_queue=None, proxy=None,
        )  # fmt: skip

    def __exit__(self, *_):
        self.viewer.close()
        os.killpg(self.process.pid, signal.SIGINT)
        try:
            self.rest, _ = self.process.communicate(timeout=20)
        finally:
            if self.process.poll() is None:
                os.killpg(self.process.pid, signal.SIGKILL)

    def send(self, op, **fields):
        self.viewer.send(json.dumps({'op': op, **fields}))

    def receive(self, op):
        """Return the next text of a kind, or data as (topic, message)."""
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            found = self.viewer.recv(20)
            if isinstance(found, bytes):
                if op == 'data' and found[0] == 1:
                    channel = self.channels[struct.unpack_from('<BI', found)[1]]
                    kind = message_type(channel['schemaName'])
                    return channel['topic'], decode(found[13:], kind)
                continue
            found = json.loads(found)
            for channel in found.get('channels', ()):
                self.channels[channel['id']] = channel
            if found['op'] == op:
                return found
        raise AssertionError(f'no {op}')

    def topics(self, wanted):
        """Wait until topics are offered and return the channels of all by topic."""
        while not wanted <= {channel['topic'] for channel in self.channels.values()}:
            self.receive('advertise')
        return {channel['topic']: number for number, channel in self.channels.items()}

    def messages(self, wanted):
        """Return a message of each of these topics."""
        numbers = self.topics(wanted)
        subscriptions = [{'id': numbers[topic], 'channelId': numbers[topic]} for topic in wanted]
        self.send('subscribe', subscriptions=subscriptions)
        found = {}
        while wanted - found.keys():
            topic, message = self.receive('data')
            found[topic] = message
        return found

    def change(self, name, value):
        """Change a parameter and return its value after that."""
        self.send('setParameters', id='x', parameters=[{'name': name, 'value': value}])
        return self.receive('parameterValues')['parameters'][0]['value']


def test_a_viewer_sees_the_loop_that_the_layout_names_and_moves_it(tmp_path):
    file = tmp_path / 'layout.json'
    with View('--layout', str(file), '--rviz', str(tmp_path / 'view.rviz')) as view:
        panels = json.loads(file.read_text())['configById'].values()
        paths = [series['value'] for panel in panels for series in panel.get('paths', ())]
        topics = {re.match(r'[\w/]+', path).group() for path in paths}
        found = view.messages(topics | {'/markers', '/diagnostics'})
        assert 'ellipse' in [marker.ns for marker in found['/markers'].markers]
        assert found['/estimate/state'].name == ['x', 'v_x', 'y', 'v_y']
        assert (tmp_path / 'view.rviz').exists()
        for path in paths:
            topic = re.match(r'[\w/]+', path).group()
            message = found[topic]
            for name, index in re.findall(r'\.(\w+)|\[(\d+)\]', path.removeprefix(topic)):
                message = getattr(message, name) if name else message[int(index)]
            assert isinstance(message, float), path

        view.send('getParameters', parameterNames=[], id='all')
        values = {
            each['name']: each['value'] for each in view.receive('parameterValues')['parameters']
        }
        weight = values['/controller.input_cost']
        heavier = [2.0 * each for each in weight]
        assert view.change('/controller.input_cost', heavier) == heavier
        before = float(variance(view))
        noise = [10.0 * each for each in values['/estimator.position.noise']]
        assert view.change('/estimator.position.noise', noise) == noise
        end = time.monotonic() + 10.0
        while float(variance(view)) < 4.0 * before:
            assert time.monotonic() < end, 'the covariance does not follow the noise'
        assert view.change('/controller.input_cost', [-1.0, 1.0]) == heavier
    assert view.process.returncode == 130
    assert 'Traceback' not in view.output + view.rest


def variance(view):
    """Return the next variance of the first state."""
    while True:
        topic, message = view.receive('data')
        if topic == '/estimate/covariance':
            return message.data[0]


def test_a_domain_is_served_as_it_is_and_only_what_is_looked_at_is_read():
    domain = Domain()
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain.id)
    node = rclpy.create_node('robot', context=context)
    node.declare_parameter('gain', 2.0)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    listeners = queue.Queue()  # the number of those of x1, whenever it changes
    matched = PublisherEventCallbacks(matched=lambda info: listeners.put(info.current_count))
    publishers = {
        '/x0': node.create_publisher(Float64, 'x0', 10),
        '/x1': node.create_publisher(Float64, 'x1', 10, event_callbacks=matched),
    }
    once = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    kept = node.create_publisher(Float64, 'kept', once)
    kept.publish(Float64(data=7.0))
    thread = threading.Thread(target=executor.spin, daemon=True)
    try:
        thread.start()
        with View('--domain', str(domain.id)) as view:
            numbers = view.topics({*publishers})
            view.send(
                'subscribe', subscriptions=[{'id': numbers['/x1'], 'channelId': numbers['/x1']}]
            )
            assert listeners.get(timeout=20.0) == 1
            assert publishers['/x0'].get_subscription_count() == 0
            publishers['/x1'].publish(Float64(data=3.0))
            topic, message = view.receive('data')
            assert (topic, message.data) == ('/x1', 3.0)
            assert view.change('/robot.gain', 5) == 5.0
            assert node.get_parameter('gain').value == 5.0
            view.send('unsubscribe', subscriptionIds=[numbers['/x1']])
            assert listeners.get(timeout=20.0) == 0
            # each viewer receives what is published once
            assert view.messages({'/kept'})['/kept'].data == 7.0
            with view.viewer:
                view.viewer = view.connect()
                assert view.messages({'/kept'})['/kept'].data == 7.0
    finally:
        executor.shutdown()
        thread.join(5.0)
        node.destroy_node()
        context.try_shutdown()
        domain.close()


def test_a_recording_is_served(tmp_path):
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/x', 'std_msgs/msg/Float64')
        for index in range(50):
            data = bytes(serialize_message(Float64(data=float(index))))
            writer.write('/x', 10**9 + index * 10**7, data)
    with View(str(tmp_path / 'bag')) as view:
        assert view.receive('serverInfo')['capabilities'] == ['playbackControl']
        assert view.messages({'/x'})['/x'].data == 0.0
        assert [view.receive('data')[1].data for _ in range(49)] == [*map(float, range(1, 50))]
