# SPDX-License-Identifier: Apache-2.0
"""The server over real sockets: what it refuses, what tabs see, and what becomes of commands."""

import json
import re
import socket
import time
from contextlib import suppress
from http.client import HTTPConnection
from pathlib import Path
from queue import Queue

import pytest

pytest.importorskip('websockets')

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from kalman_ros.live import web_server
from kalman_ros.live.board import Board
from kalman_ros.live.page_command import Command
from kalman_ros.live.web_access import Access
from kalman_ros.live.web_server import WebServer

PAGE = Path(__file__).parents[2] / 'kalman_ros' / 'live' / 'page'


class Served:
    """A server on a free port, its board and its commands."""

    def __init__(self, token=''):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]
        self.board, self.commands = Board(), Queue()
        self.access = Access('127.0.0.1', self.port, token)
        self.server = WebServer(
            self.board, lambda command, _: self.commands.put(command), self.access
        )

    @property
    def host(self):
        return f'127.0.0.1:{self.port}'

    def get(self, path='/', headers=()):
        connection = HTTPConnection('127.0.0.1', self.port, timeout=5)
        connection.request('GET', path, headers=dict(headers))
        response = connection.getresponse()
        return response.status, response.read().decode(), response.headers

    def tab(self, origin=None, headers=()):
        return connect(
            f'ws://{self.host}/socket', origin=origin or f'http://{self.host}',
            additional_headers=dict(headers), compression=None, proxy=None,
        )  # fmt: skip


@pytest.fixture
def served():
    found = Served()
    with found.server:
        yield found


def of_kind(tab, kind):
    """Return the next message of a kind."""
    while True:
        message = json.loads(tab.recv(5))
        if message['kind'] == kind:
            return message


def test_the_page_loads_nothing_from_elsewhere(served):
    status, _, headers = served.get()
    assert status == 200
    assert "script-src 'self'" in headers['Content-Security-Policy']
    for file in PAGE.iterdir():
        status, text, _ = served.get(f'/{file.name}')
        assert status == 200
        assert text == file.read_text()
        assert not re.search(r'https?://(?!\$)|@import|//cdn', text), file.name


@pytest.mark.parametrize(
    'path',
    [
        '/nothing',
        '/../board.py',
        '/%2e%2e/board.py',
        '//etc/passwd',
        '/live.js/',
        '/socket2',
        '//[x',
    ],
)
def test_only_the_files_of_the_page_are_served(served, path):
    assert served.get(path)[0] == 404


@pytest.mark.parametrize('path', ['/', '/live.js', '/socket'])
@pytest.mark.parametrize('host', ['evil.example', 'evil.example:{port}', 'localhost:1'])
def test_a_name_that_points_here_is_refused(served, path, host):
    status, text, _ = served.get(path, {'Host': host.format(port=served.port)})
    assert (status, text) == (421, 'this server has another name\n')


@pytest.mark.parametrize('origin', ['http://evil.example', 'null', 'http://localhost:{port}'])
def test_another_page_cannot_open_the_socket(served, origin):
    with pytest.raises(InvalidStatus) as refusal, served.tab(origin.format(port=served.port)):
        pass
    assert refusal.value.response.status_code == 403


def test_a_socket_without_an_origin_is_refused(served):
    with pytest.raises(InvalidStatus) as refusal:
        connect(f'ws://{served.host}/socket', proxy=None)
    assert refusal.value.response.status_code == 403


@pytest.mark.parametrize(
    'request_line',
    [b'POST / HTTP/1.1', b'GET / HTTP/9', b'GET', b'\x16\x03\x01', b'GET /' + b'x' * 20_000],
)
def test_what_is_not_a_request_is_dropped_without_a_word(served, request_line, capfd):
    with socket.create_connection(('127.0.0.1', served.port), timeout=5) as raw:
        raw.sendall(request_line + f'\r\nHost: {served.host}\r\n\r\n'.encode())
        with suppress(ConnectionError):
            raw.recv(1000)
    assert served.get()[0] == 200
    assert capfd.readouterr() == ('', '')


def test_with_a_token_nothing_is_served_without_it():
    served = Served('secret')
    with served.server:
        assert served.get()[0] == served.get('/live.js')[0] == served.get('/?token=no')[0] == 401
        with pytest.raises(InvalidStatus) as refusal, served.tab():
            pass
        assert refusal.value.response.status_code == 401
        status, _, headers = served.get('/?token=secret')
        assert (status, headers['Location']) == (303, '/')
        assert {'HttpOnly', 'SameSite=Strict'} <= {*headers['Set-Cookie'].split('; ')}
        cookie = {'Cookie': headers['Set-Cookie'].split(';')[0]}
        assert served.get('/', cookie)[0] == 200
        served.board.put('scene', {'name': 'here'})
        with served.tab(headers=cookie) as tab:
            assert of_kind(tab, 'scene')['name'] == 'here'


def test_all_tabs_see_the_same(served):
    served.board.put('scene', {'name': 'first'})
    served.board.add({'t': 1})
    with served.tab() as one, served.tab() as other:
        for tab in (one, other):
            assert of_kind(tab, 'scene')['name'] == 'first'
            assert of_kind(tab, 'frames')['frames'] == [{'t': 1}]
        served.board.put('scene', {'name': 'second'})
        served.board.add({'t': 2})
        for tab in (one, other):
            assert of_kind(tab, 'scene')['name'] == 'second'
            assert of_kind(tab, 'frames')['frames'] == [{'t': 2}]


def test_commands_are_passed_on_and_noise_is_dropped(served):
    with served.tab() as tab:
        for text in ('{', '[1]', '"x"', 'NaN', '[' * 4000, '{"do": "push"}'):
            tab.send(text)
        assert served.commands.get(timeout=5) == Command('push')
    assert served.commands.empty()


@pytest.mark.slow
def test_a_tab_that_sends_too_much_is_closed(served):
    with served.tab() as tab:
        tab.send('x' * 5000)
        with pytest.raises(Exception, match='1009|too big'):
            tab.recv(5)
    with served.tab() as tab, pytest.raises(Exception, match='1008|too many'):
        for _ in range(1000):
            tab.send('{}')
        tab.recv(5)
    assert served.get()[0] == 200


@pytest.mark.slow
def test_a_tab_that_never_reads_loses_its_place(served, monkeypatch):
    monkeypatch.setattr(web_server, '_PATIENCE', 0.2)
    with socket.socket() as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        raw.connect(('127.0.0.1', served.port))
        raw.sendall(
            f'GET /socket HTTP/1.1\r\nHost: {served.host}\r\nOrigin: http://{served.host}\r\n'
            'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
            f'Sec-WebSocket-Key: {"x" * 22}==\r\n\r\n'.encode()
        )
        with served.tab() as tab:  # another is served meanwhile, and afterwards
            for number in range(1000):
                served.board.put('scene', {'name': number, 'much': 'x' * 1_000_000})
                of_kind(tab, 'scene')
                if served.server.tabs == 1:
                    break
            assert served.server.tabs == 1


def test_a_port_in_use_is_named():
    served = Served()
    served.access.check_port()
    with served.server:
        with pytest.raises(ValueError, match=f'--port: 127.0.0.1:{served.port} cannot be used'):
            served.access.check_port()
        again = WebServer(Board(), print, served.access)
        with (
            pytest.raises(ValueError, match=f'--port: 127.0.0.1:{served.port} cannot be used'),
            again,
        ):
            pass


def test_a_slow_tab_costs_no_memory():
    board = Board()
    for k in range(5000):
        board.add({'k': k})
    assert len(board._frames) == 1000


def test_the_server_ends_at_once_with_an_open_tab(served):
    with served.tab():
        start = time.monotonic()
        served.server.__exit__()
        assert time.monotonic() - start < 4.0
