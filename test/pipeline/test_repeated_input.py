# SPDX-License-Identifier: Apache-2.0
"""An input with the stamp of the last one: two estimates of one time lead to two inputs."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags.replay import estimator_settings
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.pipeline.reading import Reading
from kalman_ros.pipeline.reading_reader import InputReader, SensorReader

SECOND = 1_000_000_000


def test_a_repeated_input_is_counted_and_is_not_a_warning():
    settings = estimator_settings('mass_spring_damper_2d')
    scenario, warnings = settings.scenario, []
    channels = {name: SensorReader(name, each) for name, each in scenario.sensors.items()}
    input = InputReader(scenario.input)
    fuser = Fuser(scenario, settings.estimator(), channels, input, warnings.append)
    for u in ([1.0, 0.0], [1.0, 0.0], [2.0, 0.0]):
        fuser.fuse([Reading(None, SECOND, np.array(u))])
    assert not warnings
    assert fuser.inputs == {Outcome.FUSED: 2, Outcome.DUPLICATE: 1}
    fuser.fuse([Reading(None, SECOND, np.array([np.nan, 0.0]))])
    assert warnings == ['force dropped: not finite']
