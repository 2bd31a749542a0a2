# SPDX-License-Identifier: Apache-2.0
"""Models in discrete time, compiled: steps of whole periods, with exact derivatives."""

import math
import pickle

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import DiscreteModel, Space

pytest.importorskip('casadi')
from kalman_ros.compiled import attempt
from kalman_ros.compiled.formulas import of_discrete_model
from kalman_ros.compiled.free_parameters import Parameters
from kalman_ros.compiled.untraceable import UntraceableError

C = pytest.mark.slow  # the compiler is another process


class Swing(DiscreteModel):
    """A pendulum by the method of Euler and Cromer, with noise that depends on its rate."""

    state = Space(('angle', 'rate'), ('rad', 'rad/s'), angles=('angle',))
    input = Space(('torque',), ('N m',))

    def __init__(self, period=0.05, gravity=9.81):
        self.period, self.gravity = period, gravity

    def next(self, x, u):
        rate = x[..., 1] + self.period * (u[..., 0] - self.gravity * np.sin(x[..., 0]))
        return np.stack([x[..., 0] + self.period * rate, rate], axis=-1)

    def noise(self, x):
        return np.diag([1e-6, 1e-4 * (1.0 + float(x[1] ** 2))])


class OwnStep(Swing):
    def step(self, x, u, dt):
        return x


class Wrong(Swing):
    def next_jacobian(self, x, u):
        return np.eye(2), np.zeros((2, 1))


class Endless(Swing):
    def noise(self, x):
        size = abs(x[1])
        while size > 1.0:
            size = 0.5 * size
        return np.diag([1e-6, 1e-4 * size])


def points(count=10):
    rng = np.random.default_rng(5)
    return rng.normal(0.0, 2.0, (count, 2)), rng.normal(0.0, 1.0, (count, 1))


def test_the_formulas_of_a_period():
    model = Swing()
    parameters = Parameters(model)
    found = of_discrete_model(model, parameters)
    p = parameters.values
    assert float(found.period.function('f')(p)) == 0.05
    for x, u in zip(*points()):
        np.testing.assert_allclose(
            np.array(found.substep.function('f')(x, u, p))[:, 0], model.next(x, u), rtol=1e-15
        )
        F = np.array(found.slope.function('f')(x, u, p))
        np.testing.assert_allclose(F, model.next_jacobian(x, u)[0], atol=1e-9)
        np.testing.assert_allclose(
            np.array(found.density.function('f')(x, p)), model.noise(x), rtol=1e-15
        )


@pytest.mark.parametrize(
    ('kind', 'reason'),
    [
        (OwnStep, 'its class defines step'),
        (Wrong, 'its next_jacobian is not that of its next'),
        (Endless, 'it decides by the value of the state in more than'),
    ],
)
def test_what_is_not_recorded_has_a_reason(kind, reason):
    model = kind()
    with pytest.raises(UntraceableError, match=reason):
        of_discrete_model(model, Parameters(model))


@C
@pytest.mark.parametrize('periods', [0, 1, 3])
def test_steps_are_those_of_the_model(periods):
    model = Swing()
    found = attempt(model)
    assert (found.arithmetic, found.reason) == ('C', '')
    x, u = points()
    dt = periods * model.period
    np.testing.assert_allclose(found.result.step(x, u, dt), model.step(x, u, dt), rtol=1e-13)
    P = np.diag([0.1, 0.2])
    for each, input in zip(x, u):
        mine = found.result.linearized_step(each, input, dt)
        theirs = model.linearized_step(each, input, dt)
        for a, b in zip(mine, theirs):
            np.testing.assert_allclose(a, b, atol=1e-8)
        for a, b in zip(
            found.result.predicted_moments(each, P, input, dt, 2),
            model.predicted_moments(each, P, input, dt, 2),
        ):
            np.testing.assert_allclose(a, b, atol=1e-8)
        Q = found.result.noise_covariance(each, input, dt)
        np.testing.assert_allclose(Q, theirs.Q, atol=1e-10)
        np.testing.assert_array_equal(Q, Q.T)


@C
def test_members_are_as_one_alone():
    model = attempt(Swing()).result
    x, u = points(7)
    moved, F, Q = model.linearized_step(x, u, 0.1)
    noisy = model.noisy_step(x, u, 0.05, np.ones((7, 2)))
    for k in range(7):
        one = model.linearized_step(x[k], u[k], 0.1)
        for whole, part in zip((moved, F, Q), one):
            np.testing.assert_array_equal(whole[k], part)
        L = np.linalg.cholesky(Swing().noise(x[k]))
        np.testing.assert_allclose(
            noisy[k], model.state.wrap(Swing().step(x[k], u[k], 0.05) + L.sum(axis=1)), rtol=1e-12
        )


@C
@pytest.mark.parametrize('dt', [0.07, -0.05, 0.05 * 200_000, math.nan, math.inf])
def test_steps_that_are_not_whole_periods_are_refused(dt):
    model = attempt(Swing()).result
    x, u = np.array([0.1, 0.2]), np.zeros(1)
    for step in (
        lambda: model.step(x, u, dt),
        lambda: model.linearized_step(x, u, dt),
        lambda: model.predicted_moments(x, np.eye(2), u, dt),
        lambda: model.noise_covariance(x, u, dt),
    ):
        with pytest.raises((ValueError, OverflowError)):
            step()


@C
def test_a_wrong_step_of_many_members_is_refused():
    model = attempt(Swing()).result
    x, u = points(3)
    with pytest.raises(ValueError, match='whole numbers'):
        model.linearized_step(x, u, 0.07)


@C
def test_in_another_process_it_is_compiled_again():
    model = attempt(Swing()).result
    other = pickle.loads(pickle.dumps(model))
    assert other.arithmetic == 'C'
    x, u = np.array([0.1, 0.2]), np.zeros(1)
    np.testing.assert_array_equal(other.step(x, u, 0.05), model.step(x, u, 0.05))


@C
def test_a_filter_of_a_plain_function_is_that_of_numpy(monkeypatch):
    def swing(x, u):
        rate = x[1] + 0.05 * (u[0] - 9.81 * math.sin(x[0]) - 0.1 * x[1] * abs(x[1]))
        return [x[0] + 0.05 * rate, rate]

    model = kr.discrete_model(swing, Q=[1e-6, 1e-4], states='a w', inputs='u', period=0.05)
    rng = np.random.default_rng(2)
    readings, inputs = rng.normal(0.0, 1.0, 200), rng.normal(0.0, 1.0, (200, 1))
    results = []
    for arithmetic in ('compiled', 'numpy'):
        monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', arithmetic)
        results.append(
            kr.filter(model, kr.sensor([1.0, 0.0], 0.1), readings=readings, inputs=inputs,
                      initial=([0.0, 0.0], [1.0, 1.0]))
        )  # fmt: skip
    assert results[0].arithmetic == 'C'
    np.testing.assert_allclose(
        results[0].mean, results[1].mean, atol=1e-6
    )  # F of numpy are differences
    assert results[0].log_likelihood == pytest.approx(results[1].log_likelihood, abs=1e-5)
