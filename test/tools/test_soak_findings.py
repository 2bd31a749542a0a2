# SPDX-License-Identifier: Apache-2.0
"""A soak judges memory only where it ran long enough, and explains what it counts."""

import numpy as np
import pytest
from tools.soak.findings import Delivery, Soak


def soak(seconds, growth, deliveries=()):
    """Return a run with one node that grows by N bytes per second."""
    time = np.arange(1.0, seconds + 1.0)
    nothing = np.zeros(len(time))
    return Soak(
        rate=100.0, time=time, resident={'plant': 1e8 + growth * time}, missed=nothing,
        withheld=nothing, median=nothing, tail=nothing, latency=(0.0, 0.0, 0.0),
        deliveries=deliveries, not_finite=(), readings=(0, 0, 0, 0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ('seconds', 'judged'), [(30, False), (120, False), (350, False), (400, True)]
)
def test_memory_is_judged_only_where_the_run_was_long_enough(seconds, judged):
    found = soak(seconds, 50_000.0)
    assert found.judges_memory is judged
    assert any('memory' in what for what in found.broken) is judged
    assert (found.summary()['allowed_growth'] is not None) is judged


def test_memory_that_stays_passes():
    assert soak(1800, 0.0).broken == []


@pytest.mark.parametrize(
    ('seconds', 'growth', 'verdict'),
    [
        (30, 50_000.0, 'PASS, 4 of 4 promises: Every promise holds.'),
        (400, 0.0, 'PASS, 5 of 5 promises: Every promise holds.'),
        (400, 50_000.0, 'FAIL, 4 of 5 promises hold'),
    ],
)
def test_the_verdict_counts_what_was_looked_at(seconds, growth, verdict):
    assert soak(seconds, growth, (Delivery('a', 'plant', 7, 7),)).verdict == verdict


@pytest.mark.parametrize(
    ('delivery', 'says'),
    [
        (Delivery('a', 'plant', 5, 3), 'a: 5 published, the plant received 3'),
        (Delivery('a', 'plant', 3, 5, 2), '2 more: 1 more publisher is on the topic'),
        (Delivery('a', 'plant', 3, 5, 4), '2 more: 3 more publishers are on the topic'),
        (Delivery('a', 'plant', 3, 5), '2 more: another publisher was on the topic, or the'),
    ],
)
def test_what_was_lost_or_came_in_excess_is_explained(delivery, says):
    (what,) = soak(30, 0.0, (delivery, Delivery('b', 'plant', 7, 7))).broken
    assert says in what
