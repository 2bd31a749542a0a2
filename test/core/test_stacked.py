# SPDX-License-Identifier: Apache-2.0
"""Models and sensors for many states at once are as those for one state after another."""

import numpy as np
import pytest

from kalman_ros.core import DiscreteLinearSystem, DiscreteModel, LinearSystem, Model, Sensor, Space
from kalman_ros.core.stacked import StackedSensor, stacked, stacked_sensor

STATE, INPUT = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))


class Spring(Model):
    """A spring that is stiffer the farther it is drawn, and noise that grows with the speed."""

    state, input = STATE, INPUT
    max_step = 0.02

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0] - x[..., 0] ** 3), axis=-1)

    def noise_density(self, x):
        return np.diag([0.1, 1.0 + x[1] ** 2])  # for one state


class SpringWithJacobian(Spring):
    """The same with Jacobians of one state."""

    def state_jacobian(self, x, u):
        assert x.shape == (2,)
        return np.array([[0.0, 1.0], [-3.0 * x[0] ** 2, 0.0]])

    def input_jacobian(self, x, u):
        return np.array([[0.0], [1.0]])


class Map(DiscreteModel):
    """A map in discrete time, with a period of half a second."""

    state, input = STATE, INPUT
    period = 0.5

    def next(self, x, u):
        return np.stack((x[..., 1], u[..., 0] * x[..., 0] - np.sin(x[..., 1])), axis=-1)

    def noise(self, x):
        return np.diag([0.1, 1.0 + x[1] ** 2])


class MapWithJacobian(Map):
    """The same with a Jacobian of one state."""

    def next_jacobian(self, x, u):
        assert x.shape == (2,)
        return np.array([[0.0, 1.0], [u[0], -np.cos(x[1])]]), np.array([[0.0], [x[0]]])


A, B, W = np.array([[0.0, 1.0], [-2.0, -0.1]]), np.array([[0.0], [3.0]]), np.diag([0.1, 1.0])
MODELS = [
    Spring(), SpringWithJacobian(), Map(), MapWithJacobian(),
    LinearSystem(A, B, W, STATE, INPUT), DiscreteLinearSystem(A, B, W, STATE, INPUT, period=0.5),
]  # fmt: skip
STATES = np.random.default_rng(1).normal(size=(2, 3, 2))
INPUTS = np.random.default_rng(2).normal(size=(2, 3, 1))


@pytest.mark.parametrize('model', MODELS, ids=lambda model: type(model).__name__)
@pytest.mark.parametrize('dt', [0.0, 0.5, 1.0])
def test_steps_of_many_states_are_those_of_each(model, dt):
    whole = stacked(model)
    moved, F, Q = whole.linearized_step(STATES, INPUTS, dt)
    F, Q = np.broadcast_to(F, (2, 3, 2, 2)), np.broadcast_to(Q, (2, 3, 2, 2))
    Q_alone = np.broadcast_to(whole.noise_covariance(STATES, INPUTS, dt), (2, 3, 2, 2))
    for k in np.ndindex(2, 3):
        x, u = STATES[k], INPUTS[k]
        expected = model.linearized_step(x, u, dt)
        np.testing.assert_allclose(moved[k], expected.state, atol=1e-9)
        np.testing.assert_allclose(whole.step(STATES, INPUTS, dt)[k], expected.state, atol=1e-9)
        np.testing.assert_allclose(F[k], expected.F, atol=1e-7)
        np.testing.assert_allclose(Q[k], expected.Q, atol=1e-7)
        np.testing.assert_allclose(Q_alone[k], model.noise_covariance(x, u, dt), atol=1e-7)
        np.testing.assert_allclose(whole.transition(x, u, dt).G, model.transition(x, u, dt).G)


@pytest.mark.parametrize('model', MODELS, ids=lambda model: type(model).__name__)
def test_one_input_serves_all_states(model):
    u = np.array([0.7])
    moved, F, _ = stacked(model).linearized_step(STATES, u, 0.5)
    for k in np.ndindex(2, 3):
        expected = model.linearized_step(STATES[k], u, 0.5)
        np.testing.assert_allclose(moved[k], expected.state, atol=1e-9)
        np.testing.assert_allclose(np.broadcast_to(F, (2, 3, 2, 2))[k], expected.F, atol=1e-7)


@pytest.mark.parametrize('model', MODELS, ids=lambda model: type(model).__name__)
def test_what_takes_leading_axes_is_left_as_it_is(model):
    whole = stacked(model)
    assert stacked(whole) is whole is not model
    assert (whole.state, whole.input, whole.is_linear) == (STATE, INPUT, model.is_linear)
    assert (whole.is_discrete, whole.max_step) == (model.is_discrete, model.max_step)
    np.testing.assert_array_equal(whole.equilibrium.state, model.equilibrium.state)
    if model.is_discrete:
        assert whole.period == 0.5


@pytest.mark.parametrize('model', MODELS[:2], ids=lambda model: type(model).__name__)
def test_the_noise_of_a_step_is_known_without_the_step(model):
    whole = stacked(model)
    Q = whole.linearized_step(STATES, INPUTS, 0.1).Q
    np.testing.assert_allclose(whole.step_noise(STATES, INPUTS, 0.1), Q, atol=1e-12)


@pytest.mark.parametrize('kind', [Spring, SpringWithJacobian])
def test_a_state_that_is_not_finite_spoils_no_other(kind, monkeypatch):
    monkeypatch.setattr(Spring, 'noise_density', lambda self, x: W)
    whole, states = stacked(kind()), STATES.copy()
    states[1, 2] = np.nan
    with np.errstate(invalid='ignore'):
        Q = whole.linearized_step(states, INPUTS, 0.1).Q
    assert np.isnan(Q[1, 2]).all()
    expected = whole.linearized_step(STATES, INPUTS, 0.1).Q
    finite = np.isfinite(states).all(axis=-1)
    np.testing.assert_allclose(Q[finite], expected[finite], rtol=1e-9)


class Distance(Sensor):
    """The distance from a place one metre to the side."""

    def __init__(self):
        self.output, self.covariance, self.name = Space(('d',), ('m',)), np.eye(1), 'distance'

    def measure(self, x):
        return np.hypot(x[..., :1], 1.0)


class DistanceWithJacobian(Distance):
    """The same with the Jacobian of one state."""

    def jacobian(self, x):
        assert x.shape == (2,)
        return np.array([[x[0] / np.hypot(x[0], 1.0), 0.0]])


def test_noise_that_is_not_finite_spoils_no_other_state():
    class Certain(Spring):
        """A spring whose slope is known where its noise is not."""

        def state_jacobian(self, x, u):
            return np.array([[0.0, 1.0], [-1.0, 0.0]])

        def noise_density(self, x):
            return np.diag([0.1, x[1] ** 2])

    x = np.array([[1.0, 2.0], [1.0, np.nan]])
    found = stacked(Certain()).linearized_step(x, np.zeros((2, 1)), 0.1)
    alone = stacked(Certain()).linearized_step(x[:1], np.zeros((1, 1)), 0.1)
    np.testing.assert_allclose(found.Q[0], alone.Q[0], rtol=1e-12)
    assert np.isnan(found.Q[1]).all()


def test_the_jacobian_of_a_sensor_takes_leading_axes():
    plain, own = Distance(), DistanceWithJacobian()
    assert stacked_sensor(plain) is plain
    whole = stacked_sensor(own)
    assert isinstance(whole, StackedSensor) and stacked_sensor(whole) is whole
    expected = [[own.jacobian(x) for x in row] for row in STATES]
    for sensor in (plain, whole):
        np.testing.assert_allclose(sensor.jacobian(STATES), expected, atol=1e-8)
        np.testing.assert_array_equal(sensor.measure(STATES), own.measure(STATES))
    louder = whole.with_covariance(4.0 * np.eye(1))
    assert louder.covariance == louder.original.covariance == 4.0
    assert whole.covariance == own.covariance == 1.0
    assert (whole.name, whole.output) == ('distance', own.output)
