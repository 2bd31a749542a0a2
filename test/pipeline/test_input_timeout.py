# SPDX-License-Identifier: Apache-2.0
"""An input that is not renewed ends at its due time, once."""

import numpy as np

from kalman_ros.pipeline.input_timeout import InputTimeout

SECOND = 1_000_000_000
IDLE = np.array([0.0, 1.0])


def test_an_input_ends_once_and_after_the_timeout():
    timeout = InputTimeout(0.5, IDLE)
    assert timeout.ended_by(9 * SECOND) == []  # nothing has come
    timeout.on_input(10 * SECOND)
    assert timeout.ended_by(10 * SECOND + SECOND // 2) == []
    ended = timeout.ended_by(11 * SECOND)
    assert [(each.source, each.time) for each in ended] == [(None, 10 * SECOND + SECOND // 2)]
    np.testing.assert_array_equal(ended[0].values, IDLE)
    assert timeout.ended_by(12 * SECOND) == []


def test_a_newer_input_prolongs_and_a_late_one_does_not_shorten():
    timeout = InputTimeout(0.5, IDLE)
    for stamp in (10.0, 10.4, 10.1):
        timeout.on_input(round(stamp * SECOND))
    assert timeout.ended_by(round(10.9 * SECOND)) == []
    assert timeout.ended_by(round(10.9 * SECOND) + 1)[0].time == round(10.9 * SECOND)
    timeout.on_input(20 * SECOND)
    assert timeout.ended_by(21 * SECOND)[0].time == round(20.5 * SECOND)


def test_without_a_timeout_no_input_ends():
    timeout = InputTimeout(0.0, IDLE)
    timeout.on_input(SECOND)
    assert timeout.ended_by(10**18) == []
