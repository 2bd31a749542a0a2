# SPDX-License-Identifier: Apache-2.0
"""Requests that another page can send through a browser are refused, whatever they name."""

import pytest

from kalman_ros.live.web_access import Access

LOCAL = Access('127.0.0.1', 8642)
OPEN = Access('0.0.0.0', 8642, 'secret')


@pytest.mark.parametrize('host', ['127.0.0.1:8642', 'localhost:8642', 'LOCALHOST:8642'])
def test_the_loopback_is_known_by_its_names(host):
    assert LOCAL.knows(host)


@pytest.mark.parametrize(
    'host',
    [
        '', 'localhost', 'localhost:80', '127.0.0.1:8643', 'evil.example:8642', '10.0.0.1:8642',
        'localhost.evil.example:8642', 'user@localhost:8642', 'localhost:8642/path',
        'localhost:8642, localhost:8642', 'localhost:x', '[::1', '0.0.0.0:8642',
    ],
)  # fmt: skip
def test_other_hosts_are_unknown(host):
    assert not LOCAL.knows(host)


def test_all_interfaces_are_known_by_address_not_by_any_name():
    assert OPEN.knows('192.168.1.7:8642')
    assert OPEN.knows('localhost:8642')
    assert not OPEN.knows('evil.example:8642')


@pytest.mark.parametrize(
    'origin',
    [
        '', 'null', 'http://evil.example', 'https://localhost:8642', 'http://localhost',
        'http://localhost:8643', 'http://127.0.0.1:8642', 'http://localhost:8642.evil.example',
    ],
)  # fmt: skip
def test_only_the_page_of_the_same_host_is_trusted(origin):
    assert LOCAL.trusts('http://localhost:8642', 'localhost:8642')
    assert not LOCAL.trusts(origin, 'localhost:8642')


def test_the_token_is_in_the_cookie_of_this_port():
    assert OPEN.admits('other=1; kalman_ros_8642=secret')
    for cookies in ('', 'kalman_ros_8642=', 'kalman_ros_8642=secre', 'kalman_ros_8643=secret',
                    'kalman_ros_8642=sécret', 'x' * 5000):  # fmt: skip
        assert not OPEN.admits(cookies)


def test_the_token_is_in_the_query():
    assert OPEN.logs_in('token=secret')
    assert not OPEN.logs_in('token=')
    assert not OPEN.logs_in('token=other&token=secret')
    assert not LOCAL.logs_in('token=')


def test_without_a_token_only_the_loopback_is_served():
    assert LOCAL.admits('')
    with pytest.raises(ValueError, match='--listen: an address beyond this machine needs a token'):
        Access('0.0.0.0', 8642)
    with pytest.raises(ValueError, match="--listen: expected an IP address, got 'example.org'"):
        Access('example.org', 8642, 'secret')


def test_the_address_to_open_has_the_token():
    assert LOCAL.url == 'http://127.0.0.1:8642/'
    assert OPEN.url == 'http://localhost:8642/?token=secret'
