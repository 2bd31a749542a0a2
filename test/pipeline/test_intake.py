# SPDX-License-Identifier: Apache-2.0
"""Messages that cannot be used are dropped and counted, with a warning now and then."""

import pytest

from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.pipeline import intake
from kalman_ros.pipeline.intake import Intake


@pytest.fixture
def clock(monkeypatch):
    """The clock by which warnings are limited."""
    time = [0.0]
    monkeypatch.setattr(intake, 'monotonic', lambda: time[0])
    return time


def refuse(data):
    raise UndecodableError('nothing in it')


def test_a_warning_comes_at_once_and_the_next_a_second_later(clock):
    warnings = []
    found = Intake(warnings.append)
    for passed, count in ((0.0, 1), (0.5, 1), (0.49, 1), (0.01, 2), (0.9, 2), (5.0, 3)):
        clock[0] += passed
        assert found.read('/y', refuse, b'abc') is None
        assert len(warnings) == count, clock
    assert warnings[1] == '/y: dropped a message of 3 bytes: undecodable; 4 so far'
    assert found.dropped('/y') == 6


def test_a_message_is_too_long_by_one_byte_more_than_the_longest():
    warnings = []
    found = Intake(warnings.append)
    found.longest = 3
    assert found.read('/y', bytes, b'abc') == b'abc'
    assert found.read('/y', bytes, b'abcd') is None
    assert found.report() == {'too long: /y': '1, the last of 4 bytes'}
    assert '(max_message_size is 3)' in warnings[0]
