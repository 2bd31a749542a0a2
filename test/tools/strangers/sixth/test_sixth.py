# SPDX-License-Identifier: Apache-2.0
"""Faults of the sixth set, and what its owners want."""

from pathlib import Path

import numpy as np

import kalman_ros as kr

from ..sets import write
from ..simulation import Channel, Readings
from .faults import connected, failing, geared, jittering, unsteady


def channel(*numbers: float) -> Channel:
    """Return readings with these values and a noise of 0.1, one in a second."""
    time = np.arange(float(len(numbers)))
    value = np.array(numbers, dtype=float)[:, np.newaxis]
    noise = np.full_like(value, 0.1)
    return Channel('a', 'range', time, value, noise, time.copy(), time.copy())


def test_a_reading_behind_a_gear_with_play_rests_after_a_reversal() -> None:
    driven = channel(0.0, 1.0, 2.0, 1.5, 1.0, 0.0)
    geared(driven, np.random.default_rng(0), 1.0)
    assert driven.value[:, 0].tolist() == [0.0, 0.5, 1.5, 1.5, 1.5, 0.5]


def test_a_sensor_that_fails_reads_its_error_without_noise() -> None:
    failed = channel(*range(200))
    failing(failed, np.random.default_rng(0), 0.25, -7.0)
    rows = failed.value[:, 0] == -7.0
    assert 30 < rows.sum() < 70
    assert (failed.noise[rows] == 0.0).all()
    assert (failed.noise[~rows] == 0.1).all()


def test_jitter_moves_stamps_and_an_unsteady_line_does_not() -> None:
    shaky, slow = channel(1.0, 2.0, 3.0), channel(1.0, 2.0, 3.0)
    jittering(shaky, np.random.default_rng(0), 0.1)
    unsteady(slow, np.random.default_rng(0), 0.1)
    assert (shaky.stamp > shaky.time).all()
    assert (slow.stamp == slow.time).all()
    assert (slow.received > slow.time).all()


def test_exchanged_sensors_send_on_the_topic_of_the_other() -> None:
    readings: Readings = {'one': channel(1.0), 'two': channel(2.0)}
    readings['two'].topic = 'b'
    connected('one', 'two')(readings, np.random.default_rng(0))
    assert [each.topic for each in readings.values()] == ['b', 'a']


def test_a_disabled_sensor_and_late_blocks_are_as_their_owners_want(tmp_path: Path) -> None:
    runs = []
    for name in ('knee_clean_without_gauge', 'greenhouse_clean_blocks'):
        write(name, tmp_path / name)
        run = kr.replay(tmp_path / name / 'recording.mcap', tmp_path / name / 'robot.yaml')
        runs.append({sensor: len(each.nis) for sensor, each in run.sensors.items()})
    assert [*runs[0]] == ['joint', 'motor']
    assert runs[1]['floor'] == runs[1]['air_a'] > 300
