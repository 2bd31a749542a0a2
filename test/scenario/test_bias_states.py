# SPDX-License-Identifier: Apache-2.0
"""Biases of sensors as states: of the estimator alone, whatever model and sensor."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import numerical_jacobian
from kalman_ros.estimators import build_filter
from kalman_ros.scenario.biased_model import BiasedModel

STD, DENSITY = 0.3, 0.01


def built(model, sensor, **values):
    return scenario.build(
        {'model': model, f'{sensor}.bias_std': [STD], f'{sensor}.bias_noise': [DENSITY], **values}
    )


CASES = [
    ('mass_spring_damper', 'position'), ('robot_2d', 'odometry'), ('turn_rate', 'lidar'),
    ('inertial', 'magnetometer'), ('robot_3d', 'imu'), ('bearing_tracker', 'bearing'),
    ('cart_pole', 'joint_states'),
]  # fmt: skip


@pytest.fixture(params=CASES, ids=lambda case: case[0], scope='module')
def case(request):
    model, sensor = request.param
    return built(model, sensor), sensor


def point(found):
    rng = np.random.default_rng(1)
    x = found.believed.initial.mean
    u = found.model.equilibrium.input
    return x + 0.1 * rng.standard_normal(x.shape), u + 0.1 * rng.standard_normal(u.shape)


def test_the_states_of_the_model_move_as_without_biases(case):
    found, _ = case
    n, (x, u) = found.model.state.size, point(found)
    whole, own = found.believed.model, found.model
    np.testing.assert_allclose(whole.step(x, u, 0.1)[:n], own.step(x[:n], u, 0.1))
    np.testing.assert_array_equal(whole.step(x, u, 0.1)[n:], x[n:])
    moved, plain = whole.linearized_step(x, u, 0.1), own.linearized_step(x[:n], u, 0.1)
    np.testing.assert_allclose(moved.F[:n, :n], plain.F)
    np.testing.assert_allclose(moved.Q[:n, :n], plain.Q)
    np.testing.assert_allclose(moved.Q[n:, n:], 0.1 * DENSITY * np.eye(len(x) - n))
    transition = whole.transition(x, u, 0.1)
    assert transition.G.shape == (len(x), len(u))
    for one, other in ((transition.F, moved.F), (transition.Q, moved.Q)):
        np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(whole.noise_covariance(x, u, 0.1), moved.Q, atol=1e-6)
    assert not whole.derivative(x, u)[n:].any()


def test_only_the_sensor_with_a_bias_reads_it(case):
    found, biased = case
    n, (x, _) = found.model.state.size, point(found)
    for name, source in found.sensors.items():
        sensor = found.believed.sensors[name]
        change = sensor.output.subtract(sensor.measure(x), source.sensor.measure(x[:n]))
        expected = x[n:] if name == biased else np.zeros_like(change)
        np.testing.assert_allclose(change, expected, atol=1e-12)
        numerical = numerical_jacobian(sensor.measure, x, sensor.output.subtract, sensor.state)
        np.testing.assert_allclose(sensor.jacobian(x), numerical, rtol=1e-5, atol=1e-6)


def test_a_linear_model_stays_one():
    found = built('mass_spring_damper', 'position')
    assert found.believed_plan.linear
    x, u = np.array([1.0, -0.5, 0.2]), np.array([2.0])
    np.testing.assert_allclose(found.believed.model.derivative(x, u)[:2],
                               found.model.derivative(x[:2], u))  # fmt: skip


def test_without_biases_nothing_is_rebuilt():
    found = scenario.build({})
    assert found.believed.model is found.model
    assert found.believed.initial is found.initial_belief
    assert found.believed.own(found.initial_belief) is found.initial_belief
    assert all(found.believed.sensors[n] is s.sensor for n, s in found.sensors.items())


def test_a_bias_is_found_between_two_sensors():
    """Two sensors of a level, one too high by 1: with one good reading it is known."""
    level = {'kind': 'states', 'measures': ['level'], 'noise': [0.1], 'rate': 1.0,
             'type': 'std_msgs/Float64MultiArray', 'fields': ['data[0]']}  # fmt: skip
    values = {f'{name}.{key}': value for name in ('good', 'high') for key, value in level.items()}
    found = built('level', 'high', sensors=['good', 'high'], initial_std=[10.0], **values,
                  **{'model_parameters.noise_density': 0.0})  # fmt: skip
    filter, believed = build_filter('kf', found.believed_plan), found.believed
    belief = believed.initial
    for y, name in ((5.0, 'good'), (6.0, 'high')):
        belief = filter.correct(belief, np.array([y]), believed.sensors[name]).posterior
    bias = believed.biases(belief)['high']
    # by hand: the level is 5 +- .1, the difference 1 +- .141, its prior 0 +- .3
    assert bias.mean[0] == pytest.approx(0.09 / (0.09 + 0.02), rel=1e-2)
    assert bias.std[0] ** 2 == pytest.approx(1.0 / (1.0 / 0.09 + 1.0 / 0.02), rel=1e-2)
    assert believed.own(belief).mean[0] == pytest.approx(5.0, abs=0.1)
    later = filter.predict(belief, np.empty(0), 10.0)
    grown = believed.biases(later)['high'].covariance - bias.covariance
    assert grown == pytest.approx(10.0 * DENSITY)


@pytest.mark.parametrize(('values', 'words'), [
    ({'position.bias_std': [0.1, 0.1, 0.1]}, 'position.bias_std'),
    ({'position.bias_std': [-0.1]}, 'bias_std'),
    ({'position.bias_noise': [-0.1]}, 'bias_noise'),
])  # fmt: skip
def test_wrong_biases_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        scenario.build(values)


def test_a_model_with_bias_states_takes_steps_as_short_as_the_model():
    model = scenario.build({'model': 'cart_pole'}).model
    model.max_step = 0.003
    assert BiasedModel(model, ['bias'], ['m'], np.eye(1)).max_step == 0.003


def test_many_states_at_once_are_each_alone(case):
    """Whatever the leading axes, as in a Monte Carlo study."""
    found, _ = case
    model = found.believed.model
    x, u = point(found)
    many = model.state.wrap(x + 0.05 * np.random.default_rng(2).standard_normal((2, 3, x.size)))
    moved = model.step(many, u, 0.01)
    assert moved.shape == many.shape
    for at in np.ndindex(2, 3):
        alone = model.step(many[at], u, 0.01)
        np.testing.assert_allclose(moved[at], alone, rtol=1e-12, atol=1e-14)
