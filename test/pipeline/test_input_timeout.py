# SPDX-License-Identifier: Apache-2.0
"""An input that is not renewed ends at its due time, once."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.input_timeout import InputTimeout
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader
from kalman_ros.pipeline.settings import settings

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


@pytest.fixture
def driven():
    """A body of one state that is driven by its input, x' = u; each command counts for 0.5 s."""
    level = {'model': 'linear', 'model_parameters.states': ['x'], 'model_parameters.A': [0.0],
             'model_parameters.B': [1.0], 'model_parameters.noise_density': [0.0],
             'sensors': ['place'], 'place.noise': [0.1], 'place.fields': ['data[0]'],
             'place.measures': ['x'], 'place.type': 'std_msgs/Float64MultiArray',
             'initial_std': [1e-6], 'input_timeout': 0.5}  # fmt: skip
    built = settings(level)
    scenario = built.scenario
    reader = SensorReader('place', scenario.sensors['place'])
    input = InputReader(scenario.input)
    timeout = built.input_timeout()
    return Fuser(scenario, built.estimator(), {'place': reader}, input, str, timeout)


def reading(stamp):
    return Reading('place', stamp, np.zeros(1))


def command(stamp):
    return Reading(None, stamp, np.ones(1))


def test_what_is_published_between_readings_stops_with_the_input(driven):
    driven.fuse([reading(10 * SECOND), command(10 * SECOND)])
    for seconds, place in ((0.3, 0.3), (0.5, 0.5), (0.8, 0.5), (30.0, 0.5)):
        found = driven.predicted(10 * SECOND + round(seconds * SECOND)).mean[0]
        assert found == pytest.approx(place, abs=1e-4), seconds
    # nothing is kept: a renewed command counts
    driven.fuse([command(10 * SECOND + SECOND // 4)])
    assert driven.predicted(11 * SECOND).mean[0] == pytest.approx(0.75, abs=1e-4)
    # and a belief that has expired has expired
    expired = driven.predicted(10 * SECOND + 100 * SECOND)
    assert expired is driven.scenario.initial_belief


@pytest.mark.parametrize(
    ('stamp', 'now', 'place', 'ended'),
    [
        (0.8, 0.5, 0.8, False),  # ahead of a clock at which a command may still come
        (0.8, 0.5 + 1e-9, 0.5, True),
        (0.5, 0.8, 0.5, False),  # late: a command may still come that is older than the clock
        (0.8, None, 0.5, True),  # a recording has no clock
    ],
)
def test_an_input_ends_by_stamps_but_by_none_ahead_of_the_clock(driven, stamp, now, place, ended):
    stamp = 10 * SECOND + round(stamp * SECOND)
    now = None if now is None else 10 * SECOND + round(now * SECOND)
    driven.fuse([reading(10 * SECOND), command(10 * SECOND)], 10 * SECOND)
    driven.fuse([reading(stamp)], now)
    assert driven.online.belief.mean[0] == pytest.approx(place, abs=1e-4)
    assert (driven.timeout.ending(20 * SECOND) is None) == ended
