# SPDX-License-Identifier: Apache-2.0
"""Options of nodes reach what they are about."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.microphone_array.node import MicrophoneArrayNode
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.plant.node import PlantNode
from kalman_ros.scenario import shipped


@pytest.mark.parametrize(
    ('given', 'wanted'),
    [({'realtime_priority': 7}, [7]), ({'realtime_priority': 0}, []),
     ({'realtime_priority': 7, 'lockstep': 'true'}, []), ({}, [30])],
)  # fmt: skip
def test_a_priority_is_asked_for_in_real_time(pair, monkeypatch, given, wanted):
    asked = []
    monkeypatch.setattr(runtime, 'take_priority', asked.append)
    pair(PlantNode, **given).node.own_process()
    assert asked == wanted


@pytest.mark.parametrize(('given', 'budget'), [
    ({}, 0.005), ({'solve_timeout': 0.25}, 0.25), ({'solve_timeout': 0.0}, np.inf),
    ({'solve_timeout': 0.25, 'lockstep': 'true'}, np.inf),
])  # fmt: skip
def test_a_plan_has_its_time(pair, given, budget):
    node = pair(ControllerNode, law='mpc', input_limit='[1.0, 1.0]', **given).node
    assert node._regulator._predictor._budget == budget


@pytest.mark.parametrize(('window', 'listens'), [(0, 0), (5, 1)])
def test_a_plant_waits_for_a_recorder_only_with_a_window(pair, window, listens):
    found = pair(PlantNode, lockstep='true', lockstep_window=window)
    assert found.node.count_subscribers('recorded') == listens


@pytest.mark.parametrize('noise', [0.02, 0.5])
def test_microphones_have_their_noise(pair, noise):
    given = {'microphone_noise': noise, 'sound_level': 0.0}
    given = {f'microphone_array:{name}': value for name, value in given.items()}  # over the file
    node = pair(MicrophoneArrayNode, str(shipped.file('sound_tracker')), **given).node
    node._start()
    frame = node._sound(np.array([5.0, 5.0]))
    np.testing.assert_allclose(frame.std(axis=1), noise, rtol=0.1)
