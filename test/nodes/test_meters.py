# SPDX-License-Identifier: Apache-2.0
"""What nodes measure of themselves is exact where the clock is known."""

import pytest

from kalman_ros.nodes import meters


@pytest.fixture
def clock(monkeypatch):
    """Have time stand still but for what the test adds to it."""
    now = [100.0]
    monkeypatch.setattr(meters, 'monotonic', lambda: now[0])
    return now


@pytest.mark.parametrize('events', [2, 3, 11])
def test_a_rate_counts_the_intervals_not_the_events(clock, events):
    rate = meters.Rate()
    for index in range(events):
        clock[0] = 100.0 + 0.25 * index
        rate.count()
    assert rate.value == pytest.approx(4.0, rel=1e-12)


def test_one_event_has_no_rate_and_silence_ends_it(clock):
    rate = meters.Rate()
    rate.count()
    assert rate.value == 0.0
    clock[0] += 0.5
    rate.count()
    clock[0] += 1.9
    assert rate.value == pytest.approx(2.0)
    clock[0] += 0.2
    assert rate.value == 0.0
