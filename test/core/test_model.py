# SPDX-License-Identifier: Apache-2.0
"""The integrator of models, its order, and what it does with its longest step."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kalman_ros.core import LinearSystem, Model, Space


class Pendulum(Model):
    """A pendulum with an input that is a torque."""

    state = Space(('angle', 'rate'), ('rad', 'rad/s'))
    input = Space(('torque',), ('N m',))

    def __init__(self, max_step=np.inf):
        self.max_step = max_step
        self.calls = 0

    def derivative(self, x, u):
        self.calls += 1
        return np.stack((x[..., 1], u[..., 0] - np.sin(x[..., 0])), axis=-1)

    def noise_density(self, x):
        return np.eye(2)


START, PUSH = np.array([1.0, 0.5]), np.array([0.3])


def exact(dt):
    model = Pendulum()
    found = solve_ivp(
        lambda _, x: model.derivative(x, PUSH), (0.0, dt), START, rtol=1e-12, atol=1e-12
    )
    return found.y[:, -1]


def test_the_error_of_a_step_falls_with_its_fifth_power():
    errors = [np.linalg.norm(Pendulum().step(START, PUSH, dt) - exact(dt)) for dt in (0.4, 0.2)]
    assert 4.5 < np.log2(errors[0] / errors[1]) < 5.5


@pytest.mark.parametrize(('dt', 'parts'), [(0.1, 1), (0.1000001, 2), (1.0, 10), (-0.25, 3)])
def test_long_steps_are_divided(dt, parts):
    model = Pendulum(max_step=0.1)
    model.step(START, PUSH, dt)
    assert model.calls == 4 * parts


def test_a_step_back_undoes_a_step():
    model = Pendulum(max_step=0.01)
    there = model.step(START, PUSH, 0.5)
    np.testing.assert_allclose(model.step(there, PUSH, -0.5), START, atol=1e-9)


def test_a_linear_step_is_exact_with_its_input():
    space, force = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))
    body = LinearSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [2.0]], np.eye(2), space, force)
    x = body.step(np.array([1.0, -1.0]), np.array([3.0]), 0.5)
    np.testing.assert_allclose(x, [1.0 - 0.5 + 0.5 * 6.0 * 0.25, -1.0 + 6.0 * 0.5], rtol=1e-14)


class WithJacobian(Pendulum):
    """A pendulum that defines its Jacobian."""

    def state_jacobian(self, x, u):
        return np.array([[0.0, 1.0], [-np.cos(x[0]), 0.0]])


class WithTransition(Pendulum):
    """A pendulum that defines its linearised step."""

    def transition(self, x, u, dt):
        raise NotImplementedError


@pytest.mark.parametrize(
    ('kind', 'analytic'), [(Pendulum, False), (WithJacobian, True), (WithTransition, True)]
)
def test_a_model_is_analytic_where_its_class_defines_a_linearisation(kind, analytic):
    assert kind().analytic is analytic


def test_an_analytic_step_is_computed_without_differences(monkeypatch):
    def fail(*_):
        raise AssertionError('differences are not needed')

    monkeypatch.setattr(Model, 'differenced_step', fail)
    assert WithJacobian().linearized_step(START, PUSH, 0.1).F.shape == (2, 2)
    with pytest.raises(AssertionError, match='not needed'):
        Pendulum().linearized_step(START, PUSH, 0.1)
