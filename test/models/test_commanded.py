# SPDX-License-Identifier: Apache-2.0
"""Robots whose commands are known: cmd_vel as the input of diff_drive and robot_2d."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Discretization, numerical_jacobian
from kalman_ros.core.model import Model

LAG = 0.2
COMMANDS = {'diff_drive': [0.8, -0.5], 'robot_2d': [0.8, 0.2, -0.5]}
#: The states that follow each of the commands.
FOLLOW = {'diff_drive': ['v', 'omega'], 'robot_2d': ['vx', 'vy', 'wz']}


def commanded(name, lag=LAG):
    values = {'model': name, 'model_parameters.command_time': lag}
    return scenario.build(values, with_law=False)


@pytest.mark.parametrize('name', COMMANDS)
def test_jacobians_are_those_of_the_derivative(name):
    model, rng = commanded(name).model, np.random.default_rng(0)
    x, u = rng.normal(size=(5, model.state.size)), rng.normal(size=(5, model.input.size))
    for a, b in zip(x, u):
        np.testing.assert_allclose(
            model.state_jacobian(a, b), Model.state_jacobian(model, a, b), atol=1e-7
        )
        found = numerical_jacobian(lambda points, a=a: model.derivative(
            np.broadcast_to(a, (*points.shape[:-1], a.size)), points), b)  # fmt: skip
        np.testing.assert_allclose(model.input_jacobian(a, b), found, atol=1e-7)


@pytest.mark.parametrize('name', COMMANDS)
def test_a_command_is_reached_with_its_lag(name):
    built = commanded(name)
    model, u = built.model, np.array(COMMANDS[name])
    which = model.state.indices(FOLLOW[name])
    x, dt, covered = np.zeros(model.state.size), 0.005, np.zeros(len(u))
    for _ in range(800):
        covered += dt * (u - x[list(which)])
        x = model.step(x, u, dt)
    np.testing.assert_allclose(x[list(which)], u, atol=1e-3)
    # the area between a step and its answer is its mean delay; that of vy couples with the turn
    np.testing.assert_allclose((covered / u)[[0, -1]], LAG, rtol=0.1)


@pytest.mark.parametrize('name', COMMANDS)
def test_without_a_lag_it_is_the_model_without_input(name):
    assert commanded(name, 0.0).model.input.size == 0
    with pytest.raises(ValueError, match=r'command_time: expected 0 or at least 0.001 s'):
        commanded(name, 1e-6)


@pytest.mark.parametrize('name', COMMANDS)
def test_a_short_lag_is_integrated_in_short_steps(name):
    model = commanded(name, 0.01).model
    x = model.step(np.zeros(model.state.size), np.array(COMMANDS[name]), 1.0)
    which = list(model.state.indices(FOLLOW[name]))
    np.testing.assert_allclose(x[which], COMMANDS[name], atol=0.02)
    F = Discretization(
        model.state_jacobian(x, np.array(COMMANDS[name])),
        model.input_jacobian(x, np.array(COMMANDS[name])),
        model.noise_density(x),
    )(1.0)[0]
    assert np.abs(np.linalg.eigvals(F)).max() < 1.0 + 1e-9


@pytest.mark.parametrize('name', COMMANDS)
def test_the_input_is_cmd_vel_by_its_names(name):
    signal = commanded(name).input
    assert (signal.topic, signal.type) == ('cmd_vel', 'geometry_msgs/Twist')
    assert signal.fields[0] == 'linear.x'
    assert signal.fields[-1] == 'angular.z'


def test_a_change_of_the_inputs_while_it_runs_is_refused():
    values = {'model': 'diff_drive'}
    full = scenario.complete(values, scenario.options(values, with_law=False))
    built = scenario.assemble(full, with_law=False)
    changed = {**full, 'model_parameters.command_time': 0.2}
    with pytest.raises(ValueError, match=r'expected a model of 0 inputs, got 2: restart'):
        scenario.rebuild(built, changed, ['model_parameters.command_time'])


@pytest.mark.parametrize(('command_time', 'longest'), [(0.02, 0.01), (5.0, None)])
def test_no_lag_makes_a_step_longer_than_that_of_the_unicycle(command_time, longest):
    usual = scenario.build({'model': 'diff_drive'}).model.max_step
    parameters = {'model_parameters.command_time': command_time}
    found = scenario.build({'model': 'diff_drive', **parameters}).model.max_step
    assert found == (usual if longest is None else longest)
