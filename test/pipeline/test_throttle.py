# SPDX-License-Identifier: Apache-2.0
"""Every warning is logged, none of them all the time."""

import pytest

from kalman_ros.pipeline import throttle as module
from kalman_ros.pipeline.throttle import Throttle


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand."""
    time = [0.0]
    monkeypatch.setattr(module, 'monotonic', lambda: time[0])
    return time


def logged(clock, period, until, seconds=1.0):
    """Return when a message that is repeated with a period is logged."""
    times = []
    throttle = Throttle(lambda _: times.append(clock[0]), seconds)
    for step in range(int(until / period)):
        clock[0] = step * period
        throttle('a')
    return times


def test_one_complaint_does_not_silence_another():
    said = []
    throttle = Throttle(said.append, seconds=60.0)
    for message in ('a', 'b', 'a', 'b', 'a'):
        throttle(message)
    assert said == ['a', 'b']


def test_what_goes_on_is_logged_after_twice_the_time(clock):
    assert logged(clock, 0.25, 20.0) == [0.0, 1.0, 3.0, 7.0, 15.0]


def test_in_hours_it_is_logged_every_ten_minutes(clock):
    times = logged(clock, 1.0, 4 * 3600.0)
    assert len(times) < 35
    assert times[-1] - times[-2] == 600.0


def test_after_a_minute_of_silence_it_is_new(clock):
    assert logged(clock, 60.0, 300.0, seconds=100.0) == [0.0, 120.0]
    assert logged(clock, 61.0, 305.0, seconds=100.0) == [0.0, 61.0, 122.0, 183.0, 244.0]


def test_a_flood_of_different_things_is_bounded(clock):
    said = []
    throttle = Throttle(said.append)
    for index in range(1000):
        clock[0] = 2.5 * index / 1000
        throttle(f'number {index}')
    assert len(said) == 60  # twenty in each second that has begun
