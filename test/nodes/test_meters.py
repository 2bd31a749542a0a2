# SPDX-License-Identifier: Apache-2.0
"""Rates and latencies that nodes measure."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware import meters


@pytest.fixture
def clock(monkeypatch):
    """Return the time, which only the test moves."""
    now = [100.0]
    monkeypatch.setattr(meters, 'monotonic', lambda: now[0])
    return now


@pytest.mark.parametrize(('events', 'interval'), [(2, 0.25), (11, 0.1), (2000, 0.001)])
def test_a_rate_is_intervals_by_time(clock, events, interval):
    rate = meters.Rate()
    for _ in range(events):
        clock[0] += interval
        rate.count()
    assert rate.value == pytest.approx(1.0 / interval, rel=1e-6)


def test_a_rate_is_zero_before_the_second_event_and_after_a_silence(clock):
    rate = meters.Rate()
    assert rate.value == 0.0
    assert rate.silence == float('inf')
    rate.count()
    assert rate.value == 0.0
    clock[0] += 0.1
    rate.count()
    clock[0] += 1.9
    assert rate.value == pytest.approx(10.0)
    clock[0] += 0.2
    assert rate.value == 0.0
    assert rate.silence == pytest.approx(2.1)


def test_percentiles_are_in_milliseconds():
    latency = meters.Latency()
    assert str(latency) == ''
    for k in range(101):
        latency.add(k * 1e-3)
    assert str(latency) == '50 / 90 / 99'
