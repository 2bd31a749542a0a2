# SPDX-License-Identifier: Apache-2.0
"""Parameters of an estimator that cannot be: which one, and what to do."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario.parameter_files import from_file

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


TWO = """\
/**:
  ros__parameters:
    model: robot_2d
    sensors: [wheels, gnss]
    wheels: {measures: [vx, wz], topic: odom, type: nav_msgs/Odometry, noise: [0.1, 0.1],
             fields: [twist.twist.linear.x, twist.twist.angular.z]}
    gnss: {measures: ['x', 'y'], topic: fix, type: sensor_msgs/NavSatFix, noise: [1.0, 1.0],
           fields: [east, north]}
/**/estimator:
  ros__parameters:
    frame: odom
    gnss: {enabled: false}
/**/estimator_map:
  ros__parameters:
    frame: map
    state: {topic: global/estimate}
"""


def test_two_estimators_share_a_file(tmp_path):
    """One of the odometry, and one of the map, by the names of their nodes (REP-105)."""
    file = tmp_path / 'robot.yaml'
    file.write_text(TWO)
    local, everywhere = (settings(from_file(file, n)) for n in ('estimator', 'estimator_map'))
    assert [*local.scenario.enabled] == ['wheels']
    assert [*everywhere.scenario.enabled] == ['wheels', 'gnss']
    assert (local.options.frame, everywhere.options.frame) == ('odom', 'map')
    assert everywhere.scenario.state.topic == 'global/estimate'


@pytest.mark.parametrize(
    ('values', 'blamed'),
    [
        ({'initial_std': [1e140, 1e140]}, 'initial_std: no filter can compute with'),
        ({'model_parameters.stiffness': -1e12}, 'model_parameters: within a step of 0.01 s'),
    ],
)
def test_what_no_filter_can_compute_with_is_named(values, blamed):
    chosen = settings({'model': 'mass_spring_damper', **values})
    with pytest.raises(ValueError, match=blamed):
        chosen.estimator()


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'sensors': [], 'gnss.topic': 'fix'}, "sensors: expected 'gnss', which has parameters"),
        ({'sensors': ['position', 'state']}, "sensors: 'state' is the name of another section"),
        (
            {'velocity.topic': 'position', 'velocity.type': 'geometry_msgs/msg/PoseStamped',
             'velocity.fields': ['pose.position.x', 'pose.position.y']},
            "velocity.type: expected geometry_msgs/PoseWithCovarianceStamped on 'position', as of "
            'position, got geometry_msgs/PoseStamped',
        ),
        (
            {'input.topic': 'position'},
            "position.type: expected geometry_msgs/WrenchStamped on 'position', as of input, got",
        ),
    ],
)  # fmt: skip
def test_sensors_that_cannot_be_are_named(changes, says):
    if changes.get('sensors') == []:
        changes = {**changes, 'gnss.noise': [1.0]}
    with pytest.raises(ValueError, match=says):
        settings(changes)


def test_a_sensor_that_is_off_has_any_type():
    off = {'velocity.topic': 'position', 'velocity.enabled': False}
    assert settings(off).scenario.enabled.keys() == {'position'}
