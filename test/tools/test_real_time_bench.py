# SPDX-License-Identifier: Apache-2.0
"""What `bench` measures of a robot in real time: both sides answer, and take processor time."""

import math
import time

import pytest

pytest.importorskip('rclpy')

from tools.bench import real_time

pytestmark = [pytest.mark.slow, pytest.mark.real_time]


@pytest.mark.parametrize(
    'load', [real_time._ROBOT, real_time._DEFAULT], ids=lambda each: each.scenario
)
@pytest.mark.parametrize('bare', [False, True], ids=['estimator', 'relay'])
def test_a_node_answers_at_the_rates_of_a_robot(load, bare, monkeypatch):
    monkeypatch.setattr(real_time, '_SECONDS', 1.0)
    with real_time.Node(load, bare=bare) as node:
        start = time.monotonic()
        assert 0.0 < node.busy() < 1.0
        assert time.monotonic() - start > 0.9  # it was not sent all at once
        late = node.late()
    assert 0.0 < late < 0.5
    assert math.isfinite(late)
