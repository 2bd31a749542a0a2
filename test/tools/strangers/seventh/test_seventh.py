# SPDX-License-Identifier: Apache-2.0
"""Faults of the seventh set."""

from pathlib import Path

import numpy as np

import kalman_ros as kr

from ..sets import write
from ..simulation import Channel
from .recordings import jittery


def test_jittery_messages_come_later_and_in_their_order() -> None:
    time = np.arange(50.0) / 10.0
    ones = np.ones((50, 1))
    channel = Channel('a', 'range', time, ones, ones.copy(), time.copy(), time + 0.001)
    jittery(channel, np.random.default_rng(0), 0.3)
    assert (np.diff(channel.received) >= 0.0).all()
    assert (channel.received > time).all()
    assert (channel.received < time + 0.302).all()
    assert (channel.stamp == time).all()


def test_hum_correlates_the_innovations_of_two_sensors_of_a_ram(tmp_path: Path) -> None:
    write('ram_hum', tmp_path)
    run = kr.replay(tmp_path / 'recording.mcap', tmp_path / 'robot.yaml')
    one, other = run.sensors['pressure'], run.sensors['rod']
    near = np.abs(other.stamp[:, np.newaxis] - one.stamp).argmin(axis=1)
    assert np.corrcoef(one.innovation[near, 0], other.innovation[:, 0])[0, 1] > 0.4
