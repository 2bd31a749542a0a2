# SPDX-License-Identifier: Apache-2.0
"""Models in discrete time are models: filters, simulation and gains take them."""

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import (
    DiscreteLinearSystem,
    DiscreteModel,
    Dynamics,
    Gaussian,
    Space,
    TimedSensor,
    check_period,
    linearize,
    unchecked,
)
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.plan import Plan

F, G, Q = np.array([[1.0, 0.1], [-0.2, 0.9]]), np.array([[0.0], [0.1]]), np.diag([0.01, 0.02])
SPACES = Space(('x', 'v'), ('', '')), Space(('u',), ('',))


class Ricker(DiscreteModel):
    """Fish of two ages, by the year."""

    state = Space(('young', 'old'), ('', ''))
    input = Space(('catch',), ('',))

    def next(self, x, u):
        young, old = x[..., 0], x[..., 1]
        return np.stack((2.0 * old * np.exp(-old), 0.5 * young + 0.6 * old - u[..., 0]), axis=-1)

    def noise(self, x):
        return np.diag([0.01, 0.02 + 0.01 * x[1] ** 2])


def test_a_linear_one_is_the_same_as_a_function():
    system = DiscreteLinearSystem(F, G, Q, *SPACES, period=0.1)
    function = kr.discrete_model(lambda x, u: F @ x + G @ u, Q, states=2, inputs=1, period=0.1)
    x, u = np.array([1.0, -2.0]), np.array([0.5])
    for count in (0, 1, 3):
        for model in (system, function):
            step = model.transition(x, u, 0.1 * count)
            np.testing.assert_allclose(step.F, np.linalg.matrix_power(F, count), atol=1e-8)
            np.testing.assert_allclose(model.step(x, u, 0.1 * count), step.F @ x + step.G @ u)
        powers = [np.linalg.matrix_power(F, k) for k in range(count)]
        np.testing.assert_allclose(step.Q, sum((P @ Q @ P.T for P in powers), np.zeros((2, 2))))
    assert isinstance(system, Dynamics) and system.is_discrete and system.period == 0.1


def test_it_has_leading_axes_and_jacobians():
    model = Ricker()
    rng = np.random.default_rng(0)
    x, u = rng.uniform(0.5, 2.0, (5, 2)), rng.uniform(0.0, 0.1, (5, 1))
    together = model.step(x, u, 3.0)
    np.testing.assert_allclose(together, [model.step(*pair, 3.0) for pair in zip(x, u)])
    old = x[0, 1]
    A, B = model.next_jacobian(x[0], u[0])
    np.testing.assert_allclose(A, [[0.0, 2 * (1 - old) * np.exp(-old)], [0.5, 0.6]], atol=1e-8)
    np.testing.assert_allclose(B, [[0.0], [-1.0]], atol=1e-8)


@pytest.mark.parametrize('kind', ['ekf', 'ukf', 'gaussian_sum'])
def test_filters_take_it(kind):
    model, sensor = Ricker(), kr.sensor([0, 1], 0.01, 'count')
    rng, x, truth = np.random.default_rng(1), np.array([1.0, 1.0]), []
    for _ in range(60):
        truth.append(x)
        x = model.step(x, np.zeros(1), 1.0) + rng.multivariate_normal([0, 0], model.noise(x))
    y = np.array(truth)[:, 1] + 0.1 * rng.normal(size=60)
    found = kr.filter(model, sensor, None, y, None, ([1, 1], 0.1), filter=kind)
    assert kr.consistency(found, truth)


@pytest.mark.parametrize('kind', ['kf', 'steady_state'])
def test_linear_filters_take_a_linear_one(kind):
    system, sensor = DiscreteLinearSystem(F, G, Q, *SPACES), kr.sensor([1, 0], 0.1)
    filter = build_filter(kind, Plan(system, {'y': TimedSensor(sensor, 1.0)}, 1.0))
    belief = filter.predict(Gaussian([0, 0], np.eye(2)), np.ones(1), 1.0)
    np.testing.assert_allclose(belief.mean, G.ravel())
    np.testing.assert_allclose(belief.covariance, F @ F.T + Q)
    with pytest.raises(ValueError, match='luenberger needs a model in continuous time'):
        build_filter('luenberger', Plan(system, {}, 1.0))


def test_what_it_has_not():
    model = Ricker()
    assert not hasattr(model, 'derivative')
    with pytest.raises(ValueError, match='model: Ricker is in discrete time, without a deriv'):
        linearize(model, np.zeros(2), np.zeros(1))
    for dt in (0.5, -1.0, 1e9):
        with pytest.raises(ValueError, match='time: expected steps that are whole numbers of 1 s'):
            model.step(np.ones(2), np.zeros(1), dt)
    with pytest.raises(ValueError, match='time: expected steps that are whole numbers of 1 s'):
        kr.filter(model, kr.sensor([0, 1], 1.0), [0.0, 0.3], [1, 1], None, ([1, 1], 1))


def test_a_belief_checks_its_sizes_but_not_in_inner_loops():
    belief = Gaussian([1, 2], [[1, 0], [0, 4]])
    np.testing.assert_array_equal(belief.std, [1, 2])
    assert belief.mean.dtype == float
    x, P = belief
    assert x is belief.mean and P is belief.covariance
    assert Gaussian(np.zeros((5, 2)), np.zeros((5, 2, 2))).mean.shape == (5, 2)
    with pytest.raises(
        ValueError, match='covariance: expected 2 x 2 for a mean of 2 numbers, got'
    ):
        Gaussian(np.zeros(2), np.eye(3))
    assert isinstance(unchecked((np.zeros(2), np.eye(2), 0)), Gaussian)


class TestTime:
    """Stamps of a model in discrete time count as those of its nearest step."""

    def estimator(self, period, **options):
        model = kr.discrete_model([[0.9]], [[1.0]], [[0.01]], period=period)
        sensor = kr.sensor([1.0], 0.1)
        return kr.OnlineEstimator(kr.KalmanFilter(model), sensor, ([0], [1]), **options)

    def test_a_clock_that_goes_back_begins_new_steps(self):
        online = self.estimator(0.2)
        for k in range(10):
            online.add_reading(100.0 + 0.2 * k, [1.0])
        for k in range(15):
            online.add_reading(5.07 + 0.2 * k, [1.0])
        assert online.restarts == 1
        assert online.time == pytest.approx(5.07 + 0.2 * 14)

    @pytest.mark.parametrize('rate', [3.0, 300.0, 700.0, 30_000.0])
    def test_a_period_need_not_be_whole_nanoseconds(self, rate):
        online = self.estimator(1.0 / rate)
        online.add_reading(0.0, [1.0])
        for k in (1, 2, 50, 5000):
            outcome, _ = online.add_reading(k / rate, [1.0])
            assert outcome.accepted
            assert online.time == pytest.approx(k / rate, abs=2e-9)

    def test_a_silence_of_too_many_periods_ends_the_belief(self):
        online = self.estimator(1e-3, max_gap=0.0)
        online.add_reading(0.0, [1.0])
        online.add_reading(101.0, [5.0])
        assert online.restarts == 1

    def test_two_readings_of_one_step_are_both_fused(self):
        online = self.estimator(0.2)
        for stamp in (0.1, 0.21, 0.29, 0.5):  # 0.1 s late, then at 0.2 and 0.4
            outcome, _ = online.add_reading(stamp, [1.0])
            assert outcome.accepted
        assert online.add_reading(0.5, [1.0])[0].value == 'dropped: duplicate stamp'

    def test_a_belief_may_be_asked_for_at_the_stamp_of_the_newest_reading(self):
        online = self.estimator(0.2)
        online.add_reading(1.0, [1.0])
        online.add_reading(1.31, [1.0])
        assert online.time == pytest.approx(1.4)
        np.testing.assert_array_equal(online.predicted(1.31).mean, online.belief.mean)
        with pytest.raises(ValueError, match='time: expected one from 1.4 on'):
            online.predicted(1.1)


@pytest.mark.parametrize('period', [0.0, -0.1, float('nan'), float('inf'), '0.1', True])
def test_a_period_is_a_number_of_seconds(period):
    model = Ricker()
    model.period = period
    with pytest.raises(ValueError, match='model: its period: expected seconds, more than 0, got'):
        check_period(model)


def test_the_rate_of_change_is_that_over_a_period():
    model = kr.discrete_model(lambda x, u: 0.5 * x + u, 0.1, states=1, inputs=1, period=0.5)
    found = model.time_derivative(np.array([[4.0], [2.0]]), np.ones((2, 1)))
    np.testing.assert_allclose(found, [[-2.0], [0.0]])


def test_a_parameter_of_a_user_s_model_may_have_any_name():
    """Such as the period of an oscillation, or the linear part of a drag."""

    class Pendulum(kr.Model):
        state, input = Space(('angle', 'rate'), ('rad', 'rad/s')), Space((), ())

        def __init__(self):
            self.period, self.linear, self.rate, self.discrete = 2.0, 0.3, 5.0, True

        def derivative(self, x, u):
            w = 2.0 * np.pi / self.period
            drag = self.linear * x[..., 1]
            return np.stack((x[..., 1], -(w**2) * np.sin(x[..., 0]) - drag), axis=-1)

        def noise_density(self, x):
            return np.diag([0.0, 0.1])

    found = kr.filter(
        Pendulum(), ([1, 0], 0.1), [0.0, 0.13, 0.4], [0.1, 0.2, 0.1], initial=([0, 0], 1)
    )
    assert found.filter == 'ekf'
    assert np.isfinite(found.mean).all()
