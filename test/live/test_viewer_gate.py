# SPDX-License-Identifier: Apache-2.0
"""Requests that a page elsewhere can send do not reach the server behind the gate."""

import socket
import threading
from contextlib import suppress
from time import monotonic, sleep

import pytest

pytest.importorskip('websockets')

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.server import serve

from kalman_ros.live.viewer_gate import ViewerGate
from kalman_ros.live.web_access import Access

pytestmark = pytest.mark.slow

HEADERS = {
    'Upgrade': 'websocket',
    'Connection': 'Upgrade',
    'Sec-WebSocket-Key': 'x' * 22 + '==',
    'Sec-WebSocket-Version': '13',
    'Sec-WebSocket-Protocol': 'foxglove.sdk.v1',
}


def echo(connection):
    for message in connection:
        connection.send(message)


class Gated:
    """A gate before a server that accepts everything, notes requests, and echoes messages."""

    def __init__(self, token='', pages=()):
        self.requests, self.refusals = [], []
        self.server = serve(
            echo, '127.0.0.1', 0, process_request=self.note,
            subprotocols=['foxglove.sdk.v1'], compression=None, max_size=None,
        )  # fmt: skip
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]
        access = Access('127.0.0.1', self.port, token)
        where = self.server.socket.getsockname()
        self.gate = ViewerGate(access, where, pages, self.refusals.append)

    def __enter__(self):
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()
        self.gate.__enter__()
        return self

    def __exit__(self, *_):
        self.gate.__exit__()
        self.server.shutdown()
        self.thread.join()

    def note(self, _, request):
        self.requests.append(request)

    def requested(self):
        """Return the first request of the gate, as soon as it is there."""
        end = monotonic() + 10.0
        while not self.requests and monotonic() < end:
            sleep(0.01)
        return self.requests[0]

    def viewer(self, **options):
        """Connect as a viewer."""
        chosen = {'subprotocols': ['foxglove.sdk.v1'], 'proxy': None, **options}
        return connect(f'ws://127.0.0.1:{self.port}/', **chosen)

    def ask(self, path='/', raw=None, **headers):
        """Send a request and return the connection and the head of the answer."""
        own = {name.replace('_', '-'): value for name, value in headers.items()}
        found = {'Host': f'localhost:{self.port}', **HEADERS, **own}
        lines = ''.join(f'{name}: {value}\r\n' for name, value in found.items())
        connection = socket.create_connection(('127.0.0.1', self.port), timeout=5)
        connection.sendall(raw or f'GET {path} HTTP/1.1\r\n{lines}\r\n'.encode())
        data = b''
        while b'\r\n\r\n' not in data:
            part = connection.recv(4096)
            if not part:
                break
            data += part
        return connection, data.decode()

    def status(self, *arguments, **headers):
        connection, head = self.ask(*arguments, **headers)
        connection.close()
        return int(head.split(' ')[1]) if head else 0


@pytest.fixture
def gated():
    with Gated() as found:
        yield found


def test_a_program_is_admitted_and_connected_both_ways(gated):
    with gated.viewer() as viewer:
        for message in ('hi', b'\x00hi', 'x' * 300_000):
            viewer.send(message)
            assert viewer.recv(10) == message


def test_a_message_that_no_viewer_sends_ends_its_connection(gated):
    with gated.viewer() as viewer, pytest.raises(ConnectionClosed, match='too big'):
        viewer.send(b'x' * 1_100_000)
        viewer.recv(10)


def test_the_page_of_a_viewer_is_admitted(gated):
    assert gated.status(Origin='https://app.foxglove.dev') == 101


@pytest.mark.parametrize(
    'origin',
    [
        'null', 'https://evil.example', 'http://app.foxglove.dev', 'http://localhost:8080',
        'https://app.foxglove.dev.evil.example', 'https://app.foxglove.dev, https://evil.example',
        'file://', 'file://evil', '\x1b[2J',
    ],
)  # fmt: skip
def test_other_pages_are_refused_and_never_reach_the_server(gated, origin):
    assert gated.status(Origin=origin) in (403, 0)
    assert gated.requests == []


def test_a_page_may_be_named():
    with Gated(pages=['http://localhost:8080']) as gated:
        assert gated.status(Origin='http://localhost:8080') == 101
        assert gated.status(Origin='http://localhost:8081') == 403
        assert gated.refusals == [
            'a page of http://localhost:8081 (--page http://localhost:8081 admits it)'
        ]


@pytest.mark.parametrize('host', ['evil.example:{}', 'localhost', 'localhost:1', ''])
def test_a_name_that_was_pointed_here_is_refused(gated, host):
    assert gated.status(Host=host.format(gated.port)) == 421
    assert gated.requests == []


def test_a_second_origin_is_not_overlooked(gated):
    lines = ''.join(f'{name}: {value}\r\n' for name, value in HEADERS.items())
    raw = (
        f'GET / HTTP/1.1\r\nHost: localhost:{gated.port}\r\nOrigin: https://app.foxglove.dev\r\n{lines}'
        f'origin: https://evil.example\r\n\r\n'
    )
    assert gated.status(raw=raw.encode()) == 403


def test_the_token_is_required_and_compared():
    with Gated(token='secret') as gated:
        assert gated.status('/') == 401
        assert gated.status('/?token=wrong') == 401
        assert gated.status('/?token=') == 401
        assert gated.requests == []
        assert gated.status('/?token=secret') == 101
        assert 'secret' not in f'{gated.requested().path} {gated.requested().headers}'


def test_the_server_receives_nothing_but_the_opening_of_a_socket(gated):
    assert (
        gated.status('/?a=b', Cookie='c=d', X_Strange='e', Origin='https://app.foxglove.dev')
        == 101
    )
    request = gated.requested()
    assert len(gated.requests) == 1
    assert request.path == '/'
    assert {*request.headers} <= {'host', *map(str.lower, HEADERS), 'user-agent'}


def test_an_older_viewer_is_answered_in_its_words(gated):
    connection, head = gated.ask(Sec_WebSocket_Protocol='foxglove.websocket.v1')
    connection.close()
    assert 'Sec-WebSocket-Protocol: foxglove.websocket.v1' in head
    assert gated.requested().headers['Sec-WebSocket-Protocol'] == 'foxglove.sdk.v1'


@pytest.mark.parametrize(
    ('raw', 'status'),
    [
        (b'POST / HTTP/1.1\r\n\r\n', 0),
        (b'GET / HTTP/1.0\r\n\r\n', 0),
        (b'\xff\xfe\r\n\r\n', 0),
        (b'GET / HTTP/1.1\r\nno header\r\n\r\n', 0),
        (b'GET / HTTP/1.1\r\nA: ' + b'x' * 100_000 + b'\r\n\r\n', 0),
        (b'GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n', 421),
    ],
)
def test_garbage_is_dropped_and_the_next_viewer_is_served(gated, raw, status):
    with suppress(ConnectionResetError):
        assert gated.status(raw=raw) == status
    assert gated.requests == []
    assert gated.status() == 101


def test_a_browser_that_opens_the_address_gets_instructions(gated):
    connection, head = gated.ask(Upgrade='no')
    with connection:
        assert head.startswith('HTTP/1.1 426 ')
        assert 'open this address in a viewer' in head + connection.recv(1000).decode()


def test_a_server_that_does_not_answer_ends_the_connection():
    with Gated() as gated:
        gated.server.shutdown()
        with gated.viewer() as viewer, pytest.raises(ConnectionClosed, match='does not answer'):
            viewer.recv(10)


@pytest.mark.thorough
def test_connections_that_say_nothing_shut_nobody_out(gated):
    silent = [socket.create_connection(('127.0.0.1', gated.port), 5) for _ in range(140)]
    try:
        assert gated.status() == 101
        silent[0].settimeout(30)
        with suppress(ConnectionResetError):  # it has five seconds
            assert silent[0].recv(1) == b''
    finally:
        for connection in silent:
            connection.close()


def test_viewers_are_limited_in_number_until_one_leaves(gated):
    viewers = [gated.ask()[0] for _ in range(32)]
    try:
        assert gated.status() == 503
        viewers.pop().close()
        # the gate hears of the end before it hears of a later connection's request, or soon after
        statuses = (gated.status() for _ in range(1000))
        assert 101 in statuses
    finally:
        for connection in viewers:
            connection.close()


def test_a_port_in_use_is_named():
    with Gated() as gated:
        other = ViewerGate(Access('127.0.0.1', gated.port), ('127.0.0.1', 1))
        message = f'--port: 127.0.0.1:{gated.port} cannot be used'
        with pytest.raises(ValueError, match=message), other:
            pass


@pytest.mark.thorough
def test_a_viewer_that_reads_nothing_does_not_hold_up_the_end():
    with Gated() as gate:
        viewer = gate.viewer(compression=None, max_queue=1)
        with suppress(ConnectionClosed, TimeoutError):
            viewer.socket.settimeout(1.0)
            while True:  # until the echo fills every buffer, since nobody reads it
                viewer.socket.sendall(b'\x82\xfe\xff\xff\0\0\0\0' + bytes(65535))
        begin = monotonic()
        gate.gate.__exit__()
        assert monotonic() - begin < 4.0
        assert not gate.gate._thread.is_alive()
        viewer.socket.close()
