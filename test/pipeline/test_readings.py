# SPDX-License-Identifier: Apache-2.0
"""Readings on their way: in the order of their stamps, with those that have none."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.tick import write_tick
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.lockstep_fuser import LockstepFuser
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader
from kalman_ros.pipeline.settings import settings

SECOND = 1_000_000_000
#: A body of one state whose place is read without stamps.
LEVEL = {
    'model': 'linear', 'model_parameters.states': ['x'], 'model_parameters.A': [0.0],
    'model_parameters.B': [1.0], 'model_parameters.noise_density': [1.0],
    'sensors': ['place'], 'place.noise': [0.1], 'place.fields': ['data[0]'],
    'place.measures': ['x'], 'place.type': 'std_msgs/Float64MultiArray',
}  # fmt: skip


@pytest.fixture
def fuser():
    built = settings(LEVEL)
    scenario = built.scenario
    reader = SensorReader('place', scenario.sensors['place'])
    return Fuser(scenario, built.estimator(), {'place': reader}, InputReader(scenario.input), str)


def message(fuser, value):
    """Return a message of the place."""
    writer = WireWriter(codec_of(fuser.scenario.sensors['place'].signal))
    data = writer(0, np.array([value]))
    if isinstance(data, bytes):
        return data
    from rclpy.serialization import serialize_message

    return bytes(serialize_message(data))


def test_of_those_that_come_together_none_is_too_old_because_of_another(fuser):
    stamps = [k * SECOND for k in (30, 1, 20, 10)]
    readings = fuser.fuse([Reading('place', stamp, np.zeros(1)) for stamp in stamps])
    assert [reading.time for reading in readings] == sorted(stamps)
    assert {reading.outcome for reading in readings} == {Outcome.FUSED}
    assert fuser.online.counts['place'] == {Outcome.FUSED: 4}
    assert fuser.fused_at == 30 * SECOND


def test_what_cannot_be_used_is_counted_once_and_has_no_correction(fuser):
    bad = Reading('place', SECOND, np.empty(0), None, Outcome.NO_FIX)
    good = Reading('place', SECOND, np.ones(1))
    assert fuser.fuse([good, bad]) == [good, bad]
    assert (bad.outcome, bad.correction, good.outcome) == (Outcome.NO_FIX, None, Outcome.FUSED)
    assert good.correction is not None
    assert fuser.online.counts['place'] == {Outcome.NO_FIX: 1, Outcome.FUSED: 1}


def test_a_message_without_a_stamp_is_known_as_such_after_it_got_its_time(fuser):
    source = fuser.scenario.sensors['place']
    reading = fuser.channels['place'].read(message(fuser, 2.0), source)
    assert (reading.source, reading.time, reading.stamped) == ('place', None, False)
    reading.time = 5 * SECOND
    fuser.fuse([reading], 5 * SECOND)
    assert not reading.stamped
    assert fuser.online.time == 5 * SECOND
    assert Reading('place', 0, np.ones(1)).stamped


class Output:
    """Keeps what is published."""

    def __init__(self):
        self.times, self.readings = [], []

    def publish(self, time, belief):
        self.times.append(time)

    def publish_innovations(self, fused):
        self.readings += fused


def test_in_lockstep_a_reading_without_a_stamp_has_the_time_of_its_step(fuser):
    output = Output()
    steps = LockstepFuser(fuser, output, str, lambda topic: f'/{topic}')
    topic = fuser.scenario.sensors['place'].signal.topic
    steps.on_reading('place', message(fuser, 2.0))
    steps.on_tick(write_tick(7 * SECOND, (f'/{topic}',)))
    assert output.times == [7 * SECOND]
    assert [(each.time, each.outcome) for each in output.readings] == [(7 * SECOND, Outcome.FUSED)]
