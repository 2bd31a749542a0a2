# SPDX-License-Identifier: Apache-2.0
"""When a node that has just become active may speak."""

import pytest

from kalman_ros.nodes.middleware import meeting
from kalman_ros.nodes.middleware.meeting import Meeting


@pytest.fixture
def clock(monkeypatch):
    time = [100.0]
    monkeypatch.setattr(meeting, 'monotonic', lambda: time[0])
    return time


def test_a_meeting_is_over_once_all_are_connected_and_stays_so(clock):
    connected = []
    found = Meeting(lambda: bool(connected))
    assert not found.over
    connected.append('plant')
    assert found.over
    connected.clear()  # who leaves later is another matter
    assert found.over


def test_nobody_is_waited_for_longer_than_a_second(clock):
    found = Meeting(lambda: False)
    clock[0] += 0.9
    assert not found.over
    clock[0] += 0.2
    assert found.over
