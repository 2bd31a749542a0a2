# SPDX-License-Identifier: Apache-2.0
"""A user's model and sensors, in a separate package, with nothing compiled."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

import kalman_ros as kr
from kalman_ros.harness import Run

PACKAGE = Path(__file__).parents[1] / 'packages' / 'pendulum_robot'


@pytest.fixture
def robot(monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    path = os.pathsep.join(filter(None, [str(PACKAGE), os.environ.get('PYTHONPATH')]))
    monkeypatch.setenv('PYTHONPATH', path)
    yield str(PACKAGE / 'pendulum.yaml')
    sys.modules.pop('pendulum_robot.pendulum', None)


@pytest.mark.parametrize('filter', mostly_thorough(['ekf', 'ukf'], 'ekf'))
@pytest.mark.executables
def test_a_class_and_a_parameter_file_make_a_robot(robot, filter):
    with Run(robot, {'filter': filter}) as run:
        run.advance(4.0)
        loop = run.trajectory()
        said = run.processes['estimator'].output()
    assert 'the sensors observe theta, omega' in said
    error = run.scenario.model.state.subtract(loop.truth, loop.estimate)
    std = np.sqrt(loop.covariance.diagonal(axis1=1, axis2=2))
    assert len(loop.time) == 401
    assert np.mean(np.abs(error) < 3.0 * std) > 0.97
    assert abs(loop.truth[0, 0]) == 1.0
    assert np.abs(loop.truth[200:, 0]).max() < 0.2


ROOM = """
/**:
  ros__parameters:
    model: pendulum_robot.thermostat:Thermostat
    model_parameters: {loss: 0.05}
    sensors: [thermometer]
    thermometer: {kind: states, measures: [room], noise: [0.3], rate: 5.0,
                  type: sensor_msgs/Temperature, fields: [temperature]}
    input: {topic: heating, type: geometry_msgs/WrenchStamped, fields: [wrench.force.x]}
    initial_state: [3.0, -1.0]
    initial_std: [2.0, 2.0]
    state_cost: [1.0, 0.1]
    input_cost: [0.1]
    filter: ekf
    rate: 5.0
"""


def test_a_model_in_discrete_time_is_a_robot_too(robot, tmp_path):
    path = tmp_path / 'room.yaml'
    path.write_text(ROOM)
    with Run(str(path)) as run:
        run.advance(40.0)
        loop = run.trajectory()
    error = loop.truth - loop.estimate
    std = np.sqrt(loop.covariance.diagonal(axis1=1, axis2=2))
    assert len(loop.time) == 201
    assert np.mean(np.abs(error) < 3.0 * std) > 0.97
    assert np.abs(loop.input).max() > 0.5
    alone = kr.simulate(str(path), seconds=40.0, seed=0)
    np.testing.assert_allclose(loop.estimate, alone.estimate, atol=1e-9)


def test_the_rate_of_a_model_in_discrete_time_is_that_of_its_steps(robot, tmp_path):
    path = tmp_path / 'room.yaml'
    path.write_text(ROOM.replace('rate: 5.0\n"""', '').replace('    rate: 5.0', '    rate: 20.0'))
    with pytest.raises(ValueError, match='rate: expected 5, one step for each period of the mod'):
        kr.load(str(path))


def test_a_linear_system_by_yaml_alone(tmp_path):
    """Three states in a chain that grows, one reading, one input: nothing but numbers."""
    path = tmp_path / 'chain.yaml'
    path.write_text("""
/**:
  ros__parameters:
    model: linear
    model_parameters:
      states: [a, b, c]
      state_units: ['', '', '']
      A: [0.1, 1.0, 0.0,  0.0, -0.5, 1.0,  0.0, 0.0, -1.0]
      B: [0.0, 0.0, 1.0]
      noise_density: [0.01, 0.0, 0.02]
    sensors: [gauge]
    gauge: {kind: linear, C: [1.0, 0.5, 0.0], noise: [0.1], rate: 25.0,
            type: sensor_msgs/FluidPressure, fields: [fluid_pressure]}
    input: {topic: valve, type: geometry_msgs/WrenchStamped, fields: [wrench.force.x]}
    initial_state: [1.0, 0.0, 0.0]
""")
    with Run(str(path)) as run:
        run.advance(8.0)
        loop = run.trajectory()
    assert np.abs(loop.truth[-1]).max() < 1.0
    assert np.abs(loop.truth[-1, 0] - loop.estimate[-1, 0]) < 4.0 * np.sqrt(
        loop.covariance[-1, 0, 0]
    )


def test_what_no_filter_can_follow_is_refused(tmp_path):
    from kalman_ros.harness import NodeError

    path = tmp_path / 'blind.yaml'
    path.write_text("""
/**:
  ros__parameters:
    model: linear
    model_parameters: {A: [0.5, 0.0, 0.0, -1.0], B: [1.0, 1.0], noise_density: [0.1, 0.1]}
    position.C: [0.0, 1.0]
""")
    says = 'the estimator died: estimator: sensors: no sensor sees the growing mode at 0.5'
    with pytest.raises(NodeError, match=says), Run(str(path)):
        pass
