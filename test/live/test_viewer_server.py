# SPDX-License-Identifier: Apache-2.0
"""The server by a client of its protocol: schemas, messages, parameters."""

import json
import os
import socket
import struct
from contextlib import suppress
from math import inf
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('foxglove')
pytest.importorskip('websockets')

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from kalman_ros.live.viewer_server import ViewerServer
from kalman_ros.live.web_access import Access


class Kept:
    """Parameters in a dictionary."""

    def __init__(self):
        self.values = {'/a.gain': [1.0, inf], '/a.name': 'x', '/a.count': 3, '/a.on': True}

    def read(self, names):
        return {name: self.values[name] for name in names or self.values if name in self.values}

    def change(self, values):
        if '/a.name' in values:
            return '/a: name: it is read-only'
        self.values.update(values)
        return ''


class Viewer:
    """A client of the protocol."""

    def __init__(self, port, **options):
        self.socket = connect(
            f'ws://127.0.0.1:{port}', subprotocols=['foxglove.sdk.v1'], proxy=None, **options
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send(self, op, **fields):
        self.socket.send(json.dumps({'op': op, **fields}))

    def processed(self):
        """Wait until what was sent so far is processed, which is in its order."""
        self.send('getParameters', parameterNames=['/a.on'], id='processed')
        self.next('parameterValues')

    def next(self, op):
        """Return the next message of a kind; bytes for ``'data'``."""
        while True:
            found = self.socket.recv(5)
            if isinstance(found, bytes):
                if op == 'data':
                    return found
            elif json.loads(found)['op'] == op:
                return json.loads(found)


@pytest.fixture
def served():
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    with ViewerServer('name', Access('127.0.0.1', port), Kept()) as server:
        server.port = port
        yield server


def test_a_topic_is_subscribed_to_by_its_schema_and_its_bytes_arrive(served):
    served.offer('/estimate/state', 'sensor_msgs/msg/JointState')
    with Viewer(served.port) as viewer:
        assert viewer.next('serverInfo')['capabilities'] == ['parameters', 'parametersSubscribe']
        (channel,) = viewer.next('advertise')['channels']
        assert channel['topic'] == '/estimate/state'
        assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
        assert channel['schemaName'] == 'sensor_msgs/msg/JointState'
        assert 'MSG: std_msgs/Header' in channel['schema']
        assert served.wanted == set()
        viewer.send('subscribe', subscriptions=[{'id': 9, 'channelId': channel['id']}])
        viewer.processed()
        assert served.wanted == {'/estimate/state'}
        message = JointState(name=['x'], position=[1.5])
        served.publish('/estimate/state', serialize_message(message), 123)
        data = viewer.next('data')
        assert struct.unpack_from('<BIQ', data) == (1, 9, 123)
        assert deserialize_message(data[13:], JointState) == message
        viewer.send('unsubscribe', subscriptionIds=[9])
        viewer.processed()
        assert served.wanted == set()


def values(message):
    return {each['name']: each['value'] for each in message['parameters']}


def test_parameters_are_read_and_changed(served):
    with Viewer(served.port) as viewer:
        viewer.send('getParameters', parameterNames=[], id='1')
        found = values(viewer.next('parameterValues'))
        # JSON has no infinity
        assert found.pop('/a.gain') == ['1.0', 'inf']
        assert found == {'/a.name': 'x', '/a.count': 3, '/a.on': True}
        changes = [{'name': '/a.count', 'value': 4}]
        viewer.send('setParameters', id='2', parameters=changes)
        assert values(viewer.next('parameterValues')) == {'/a.count': 4}


def test_a_refusal_is_shown_with_the_value_as_it_is(served):
    with Viewer(served.port) as viewer:
        changes = [{'name': '/a.name', 'value': 'y'}]
        viewer.send('setParameters', id='3', parameters=changes)
        assert viewer.next('status')['message'] == '/a: name: it is read-only'
        viewer.send('getParameters', parameterNames=['/a.name'], id='4')
        assert values(viewer.next('parameterValues')) == {'/a.name': 'x'}


def test_a_change_by_others_is_shown_to_those_who_asked(served):
    with Viewer(served.port) as viewer:
        viewer.send('subscribeParameterUpdates', parameterNames=['/a.count'])
        viewer.send('getParameters', parameterNames=['/a.on'], id='5')
        viewer.next('parameterValues')
        served.show({'/a.count': 4, '/a.name': 'z'})
        (found,) = viewer.next('parameterValues')['parameters']
        assert (found['name'], found['value']) == ('/a.count', 4)


def test_a_page_elsewhere_cannot_connect(served):
    with pytest.raises(InvalidStatus, match='403'):
        Viewer(served.port, origin='https://evil.example')


def own_addresses(port):
    """Return where this process, of all that may use this port, listens at it."""
    own = set()
    for link in Path('/proc/self/fd').iterdir():
        with suppress(OSError):
            own.add(os.readlink(link))
    addresses = set()
    for line in Path('/proc/net/tcp').read_text().splitlines()[1:]:
        _, local, _, state, *rest = line.split()
        address, _, number = local.partition(':')
        if state == '0A' and int(number, 16) == port and f'socket:[{rest[5]}]' in own:
            addresses.add(socket.inet_ntoa(bytes.fromhex(address)[::-1]))
    return addresses


def test_nobody_can_guess_where_the_library_listens(served):
    """It admits everybody, so it must not be where a page would look."""
    addresses = set()
    for _ in range(3):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            port = probe.getsockname()[1]
        with ViewerServer('name', Access('127.0.0.1', port)) as server:
            address, inner = server._gate._server
            addresses.add(address)
            assert inner != port
            assert address.startswith('127.')
            assert own_addresses(inner) == {address}
    assert len(addresses) == 3
