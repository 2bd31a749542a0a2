# SPDX-License-Identifier: Apache-2.0
"""Robots whose commands are known: cmd_vel as the input of diff_drive and robot_2d."""

import numpy as np
import pytest

import kalman_ros as kr
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


def limited(limits):
    values = {'model': 'robot_2d', 'model_parameters.command_time': LAG}
    return scenario.build(
        {**values, 'model_parameters.acceleration_limits': limits}, with_law=False
    ).model


def test_jacobians_with_limits_are_those_of_the_derivative():
    model, rng = limited([0.8, 2.0, 1.5]), np.random.default_rng(2)
    beyond = 0
    for x, u in zip(rng.normal(size=(40, 8)), rng.normal(size=(40, 3))):
        np.testing.assert_allclose(
            model.state_jacobian(x, u), Model.state_jacobian(model, x, u), atol=1e-7
        )
        found = numerical_jacobian(lambda points, x=x: model.derivative(
            np.broadcast_to(x, (*points.shape[:-1], 8)), points), u)  # fmt: skip
        np.testing.assert_allclose(model.input_jacobian(x, u), found, atol=1e-7)
        beyond += not found.any()
    assert 5 < beyond < 35  # some commands are followed, others are beyond all limits


def test_commands_accelerate_within_the_limits_and_reach_them():
    model, u, dt = limited([0.5, 0.4, 0.8]), np.array([0.0, 0.0, 3.0]), 0.005
    x, largest = np.zeros(8), 0.0
    for _ in range(1500):
        later = model.step(x, u, dt)
        largest = max(largest, (later[5] - x[5]) / dt)
        x = later
    assert largest == pytest.approx(0.8, rel=1e-6) and x[5] == pytest.approx(3.0, abs=0.01)
    x, u, largest = np.zeros(8), np.array([2.0, 0.0, 0.0]), 0.0
    for _ in range(1500):
        later = model.step(x, u, dt)
        largest = max(largest, (later[3] - x[3]) / dt)
        x = later
    assert 0.49 < largest <= 0.5 * (1 + 1e-9) and x[3] == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize('limits', [[1.0, 1.0], [1.0, 0.0, 1.0], [1.0, -1.0, 1.0], [np.nan] * 3])
def test_limits_that_are_none_are_refused(limits):
    with pytest.raises(ValueError, match='acceleration_limits'):
        limited(limits)


@pytest.mark.parametrize(('name', 'posed', 'rates'), [('robot_2d', 3, 3), ('robot_3d', 6, 6)])
def test_the_noise_of_the_pose_grows_with_the_square_of_the_speed(name, posed, rates):
    """As robot_localization's dynamic process noise."""
    pose = {
        'robot_2d': {'position_noise': [0.1, 0.2], 'heading_noise': 0.3},
        'robot_3d': {'position_noise': [0.1, 0.2, 0.3], 'orientation_noise': [0.4, 0.5, 0.6]},
    }[name]
    given = {'model': name, **{f'model_parameters.{key}': value for key, value in pose.items()}}
    constant = scenario.build(given, with_law=False).model
    by_speed = {**given, 'model_parameters.noise_by_speed': True}
    model, n = scenario.build(by_speed, with_law=False).model, constant.state.size
    x = np.random.default_rng(1).normal(size=(4, n))
    for at, found in zip(x, model.noise_density(x)):
        speed = at[posed : posed + rates]
        wanted = constant.noise_density(at).copy()
        wanted[:posed, :posed] *= speed @ speed
        np.testing.assert_allclose(found, wanted, atol=1e-15)
        np.testing.assert_allclose(model.noise_density(at), wanted, atol=1e-15)
    np.testing.assert_array_equal(model.noise_density(np.zeros(n))[:posed, :posed], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'given'),
    [
        ('robot_2d', {'noise_by_speed': True, 'heading_noise': 0.3}),
        ('robot_3d', {'noise_by_speed': True, 'orientation_noise': [0.4, 0.5, 0.6]}),
        ('robot_2d', {'command_time': 0.2, 'acceleration_limits': [0.5, 1.0, 2.0]}),
    ],
)
def test_compiled_they_are_the_same(name, given):
    pytest.importorskip('casadi')
    given = {f'model_parameters.{key}': value for key, value in given.items()}
    model = scenario.build({'model': name, **given}, with_law=False).model
    fast = kr.compile(model)
    assert fast.arithmetic
    rng = np.random.default_rng(3)
    for _ in range(10):
        x, u = rng.normal(size=model.state.size), rng.normal(size=model.input.size)
        np.testing.assert_allclose(fast.step(x, u, 0.02), model.step(x, u, 0.02), atol=1e-12)
        np.testing.assert_allclose(
            fast.transition(x, u, 0.02).Q, model.transition(x, u, 0.02).Q, atol=1e-9
        )


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
