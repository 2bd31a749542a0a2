# SPDX-License-Identifier: Apache-2.0
"""Parameters of an estimator that cannot be: which one, and what to do."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.pipeline.settings import settings

RADAR = {'radar.kind': 'states', 'radar.noise': [1.0], 'radar.topic': 'radar'}


def test_a_section_of_a_sensor_that_is_not_listed_is_named():
    says = "sensors: expected 'radar', which has parameters such as radar.noise, among them, got"
    with pytest.raises(ValueError, match=f'^{says} position, velocity'):
        settings(RADAR)
    with pytest.raises(ValueError, match=f'^{says} position$'):
        settings({**RADAR, 'sensors': ['position']})


def test_a_single_name_is_a_mistake_in_writing():
    with pytest.raises(ValueError, match="did you mean 'position.noise'"):
        settings({'positon.noise': [0.1, 0.1]})


def test_the_input_of_a_model_without_one_is_no_sensor():
    given = {'model': 'robot_3d', 'input.topic': 'cmd', 'input.type': 'geometry_msgs/Twist'}
    with pytest.raises(ValueError, match="unknown parameter 'input.topic'"):
        settings(given)
