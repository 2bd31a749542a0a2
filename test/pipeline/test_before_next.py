# SPDX-License-Identifier: Apache-2.0
"""What is to happen before readings are fused happens once, the latest of several alone."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags.replay import estimator_settings
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader


def test_it_happens_once_and_before():
    settings = estimator_settings('mass_spring_damper_2d')
    scenario = settings.scenario
    channels = {name: SensorReader(name, each) for name, each in scenario.sensors.items()}
    input = InputReader(scenario.input)
    fuser = Fuser(scenario, settings.estimator(), channels, input, str)
    seen = []
    for number in (1, 2):
        fuser.before_next = lambda n=number: seen.append((n, fuser.inputs.total()))
    for time in (1, 2):
        fuser.fuse([Reading(None, time, np.zeros(2))])
    assert seen == [(2, 0)]
