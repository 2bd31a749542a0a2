# SPDX-License-Identifier: Apache-2.0
"""Filters against each other, against filterpy and against the Riccati equation."""

from dataclasses import dataclass

import numpy as np
import pytest
from random_systems import Linear, random_plan

from kalman_ros import scenario
from kalman_ros.control.lqe import dlqe
from kalman_ros.core import (
    DesignError,
    Gaussian,
    LinearSystem,
    Model,
    Sensor,
    Space,
    TimedSensor,
    variances,
)
from kalman_ros.estimators import FILTERS, build_filter, filter_class
from kalman_ros.estimators.consistency import nees
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter
from kalman_ros.estimators.plan import Plan, parts
from kalman_ros.linear.factor import cholesky
from kalman_ros.models.turn_rate import TurnRate


class Bearing(Sensor):
    """The direction of a point that moves in the plane, and its own heading."""

    def __init__(self, noise=0.05):
        self.output = Space(('bearing',), ('rad',), angles=('bearing',))
        self.covariance, self.name = variances('noise', [noise], 1), 'bearing'

    def measure(self, x):
        return np.arctan2(x[..., 1], x[..., 0])[..., np.newaxis]


class Unicycle(Model):
    state = Space(('x', 'y', 'psi'), ('m', 'm', 'rad'), angles=('psi',))
    input = Space(('v', 'omega'), ('m/s', 'rad/s'))
    max_step = 0.05

    def derivative(self, x, u):
        psi, v, omega = x[..., 2], u[..., 0], u[..., 1]
        return np.stack((v * np.cos(psi), v * np.sin(psi), omega), axis=-1)

    def noise_density(self, x):
        return np.diag([0.01, 0.01, 0.02])


def unicycle_plan():
    return Plan(Unicycle(), {'bearing': TimedSensor(Bearing(), 10.0)}, 10.0)


def run(filter, sensor, belief, rng, steps=40, m=2):
    """Yield the beliefs of a run on random readings and uneven steps."""
    for _ in range(steps):
        dt, u = rng.uniform(0.01, 0.1), rng.normal(size=m)
        belief = filter.predict(belief, u, dt)
        y = sensor.measure(belief.mean) + 0.3 * rng.normal(size=sensor.output.size)
        belief = filter.correct(belief, sensor.output.wrap(y), sensor).posterior
        yield belief


def same_beliefs(ones, others, tolerance=1e-9):
    for one, other in zip(ones, others, strict=True):
        np.testing.assert_allclose(one.mean, other.mean, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(
            one.covariance, other.covariance, rtol=tolerance, atol=tolerance
        )


#: Filters of any model, and of linear ones alone.
OF_ANY = [name for name in FILTERS if not filter_class(name).needs_linear]
OF_LINEAR = [name for name in FILTERS if name not in OF_ANY]


@pytest.mark.parametrize('kind', OF_ANY)
@pytest.mark.parametrize('seed', range(8))
def test_on_linear_systems_every_filter_is_the_kalman_filter(kind, seed):
    _, plan, sensor = random_plan(seed)
    prior = Gaussian(np.ones(4), np.diag([0.5, 1.0, 2.0, 1.0]))
    same_beliefs(
        run(build_filter('kf', plan), sensor, prior, np.random.default_rng(seed)),
        run(build_filter(kind, plan), sensor, prior, np.random.default_rng(seed)),
    )


@pytest.mark.parametrize('kind', ['kf', 'ekf', 'ukf'])
@pytest.mark.parametrize('seed', range(4))
def test_native_equals_filterpy_on_linear_systems(kind, seed):
    pytest.importorskip('filterpy')
    _, plan, sensor = random_plan(seed)
    prior = Gaussian(np.ones(4), np.diag([0.5, 1.0, 2.0, 1.0]))
    same_beliefs(
        run(build_filter(kind, plan), sensor, prior, np.random.default_rng(seed)),
        run(
            build_filter(kind, plan, implementation='filterpy'),
            sensor, prior, np.random.default_rng(seed),
        ),
    )  # fmt: skip


def strided(M):
    """Return the matrix as every other number of a larger one."""
    wide = np.zeros((2 * M.shape[0], 2 * M.shape[1]))
    wide[::2, ::2] = M
    return wide[::2, ::2]


@pytest.mark.parametrize('kind', sorted(FILTERS))
@pytest.mark.parametrize('laid_out', [np.ascontiguousarray, np.asfortranarray, strided])
def test_however_matrices_lie_in_memory_they_are_read_and_left_alone(kind, laid_out):
    _, plan, sensor = random_plan(3)
    P, u, y = np.diag([0.5, 1.0, 2.0, 1.0]) + 0.1, np.ones(2), np.array([0.3, -0.2])
    expected = build_filter('kf', plan).correct(Gaussian(np.ones(4), P), y, sensor).posterior

    filter = build_filter(kind, plan)
    sensor.C, sensor.covariance = laid_out(sensor.C), laid_out(sensor.covariance)
    prior = Gaussian(np.ones(4), laid_out(P))
    for array in (prior.mean, prior.covariance, u, y, sensor.C, sensor.covariance):
        array.flags.writeable = False
    before = filter.predict(prior, u, 0.1)
    found = filter.correct(prior, y, sensor)
    posterior = found.posterior
    np.testing.assert_array_equal(filter.predict(prior, u, 0.1).covariance, before.covariance)
    if not filter_class(kind).fixed_gain:
        same_beliefs([posterior], [expected])
    np.testing.assert_array_equal(posterior.covariance, posterior.covariance.T)
    again = filter.correct(prior, y, sensor)
    np.testing.assert_array_equal(again.posterior.covariance, posterior.covariance)
    assert again.nis == found.nis


@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_native_equals_filterpy_on_a_nonlinear_system_with_angles(kind):
    pytest.importorskip('filterpy')
    plan, sensor = unicycle_plan(), Bearing()
    prior = Gaussian(np.array([-2.0, 0.1, 3.1]), np.diag([0.1, 0.1, 0.2]))
    same_beliefs(
        run(build_filter(kind, plan), sensor, prior, np.random.default_rng(0)),
        run(
            build_filter(kind, plan, implementation='filterpy'),
            sensor, prior, np.random.default_rng(0),
        ),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('kind', OF_ANY)
def test_angles_that_turn_round_and_round_lose_nothing(kind):
    model, sensor = Unicycle(), Bearing()
    filter = build_filter(kind, unicycle_plan())
    rng = np.random.default_rng(1)
    x = np.array([3.0, 0.0, np.pi / 2])
    belief = Gaussian(x + 0.1, np.diag([0.1, 0.1, 0.1]))
    u = np.array([1.5, 0.5])  # a circle of radius 3 about the sensor, four times round
    for _ in range(500):
        x = model.step(x, u, 0.1)
        belief = filter.predict(belief, u, 0.1)
        y = sensor.output.wrap(sensor.measure(x) + 0.05 * rng.normal(size=1))
        belief = filter.correct(belief, y, sensor).posterior
        assert abs(belief.mean[2]) <= np.pi
        error = model.state.subtract(x, belief.mean)
        assert np.all(np.abs(error) < 5.0 * belief.std + 0.2)


def test_the_steady_state_filter_has_the_gain_of_the_riccati_equation():
    _, plan, sensor = random_plan(2)
    step = plan.model.sampled(plan.dt)
    expected = dlqe(step.F, sensor.C, step.Q, sensor.covariance)
    found = build_filter('steady_state', plan)
    np.testing.assert_allclose(found.gains['y'], expected.gain, rtol=1e-6)


@pytest.mark.parametrize('kind', ['steady_state', 'luenberger'])
def test_the_covariance_of_a_fixed_gain_is_that_of_its_errors(kind):
    """Of many runs of the same observer, also one that is not optimal."""
    system = scenario.build({'model': 'mass_spring_damper'})
    plan = system.plan
    observer = build_filter(kind, plan)
    rng = np.random.default_rng(0)
    runs = 4000
    x = rng.normal(size=(runs, 2))
    mean, P = np.zeros((runs, 2)), np.eye(2)
    step, u = plan.model.sampled(plan.dt), np.zeros(1)
    for k in range(60):
        x = x @ step.F.T + rng.multivariate_normal(np.zeros(2), step.Q, runs)
        belief = observer.predict(Gaussian(np.zeros(2), P), u, plan.dt)
        mean, P = mean @ step.F.T, belief.covariance
        for name in plan.due(k):
            sensor = plan.sensors[name].sensor
            noise = rng.multivariate_normal(np.zeros(1), sensor.covariance, runs)
            y = sensor.measure(x) + noise
            mean = mean + (y - sensor.measure(mean)) @ observer.gains[name].T
            P = observer.correct(Gaussian(np.zeros(2), P), np.zeros(1), sensor)
            P = P.posterior.covariance
    error = x - mean
    sample = error.T @ error / runs
    scale = np.sqrt(np.outer(P.diagonal(), P.diagonal()))
    assert np.all(np.abs(sample - P) < 0.08 * scale)


@pytest.mark.parametrize(
    ('options', 'expected'),
    [
        ({'observer_poles': [-5.0, -8.0]}, [-8.0, -5.0]),
        (
            {'observer_poles': [-6.0, -6.0], 'observer_frequencies': [4.0, -4.0]},
            [-6.0 - 4.0j, -6.0 + 4.0j],
        ),
    ],
)
def test_a_luenberger_observer_has_its_poles(options, expected):
    system = scenario.build({'model': 'mass_spring_damper', 'rate': 1000.0,
                             'position.rate': 1000.0, 'velocity.rate': 1000.0})  # fmt: skip
    observer = build_filter('luenberger', system.plan, options)
    F = system.model.sampled(1e-3).F
    over = F
    for name, timed in system.plan.sensors.items():
        C = timed.sensor.jacobian(np.zeros(2))
        over = (np.eye(2) - observer.gains[name] @ C) @ over
    poles = np.sort_complex(np.log(np.linalg.eigvals(over).astype(complex)) / 1e-3)
    np.testing.assert_allclose(poles, expected, rtol=0.02)


@pytest.mark.parametrize(
    ('kind', 'values', 'options', 'says'),
    [
        ('luenberger', {}, {'observer_poles': [-900.0]}, 'observer_poles: too fast'),
        ('luenberger', {}, {'observer_poles': [1.0]}, 'observer_poles: expected'),
        ('luenberger', {}, {'observer_frequencies': [1.0]}, 'observer_poles: expected every'),
        ('luenberger', {}, {'observer_frequencies': [0.0] * 3}, 'expected at most 2 numbers'),
        ('ukf', {}, {'kappa': -9.0}, 'kappa: expected more than -2'),
        ('kv', {}, {}, "unknown filter 'kv'"),
    ],
)
def test_what_cannot_work_says_why(kind, values, options, says):
    plan = scenario.build({'model': 'mass_spring_damper', **values}).plan
    with pytest.raises(ValueError, match=says):
        build_filter(kind, plan, options)


@pytest.mark.slow
def test_an_unobservable_mode_that_grows_has_no_steady_state():
    space = Space(('a', 'b'), ('', ''))
    system = LinearSystem(np.diag([0.1, -1.0]), np.eye(2), np.eye(2), space, space)
    sensor = Linear(np.array([[0.0, 1.0]]), np.eye(1), 'y')
    plan = Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0)
    for kind in ('steady_state', 'luenberger'):
        with pytest.raises(DesignError):
            build_filter(kind, plan)


def test_an_observer_without_sensors_is_refused():
    space = Space(('a',), ('',))
    system = LinearSystem(np.eye(1), np.eye(1), np.eye(1), space, space)
    with pytest.raises(DesignError, match='filter: luenberger needs at least one enabled sensor'):
        build_filter('luenberger', Plan(system, {}, 10.0))


@pytest.mark.parametrize('kind', OF_LINEAR)
def test_linear_filters_refuse_other_models(kind):
    with pytest.raises(ValueError, match=f'filter: {kind} needs a linear model, got Unicycle'):
        build_filter(kind, unicycle_plan())


@dataclass
class Case:
    P: np.ndarray
    repairs: int


@pytest.mark.parametrize(
    'case',
    [
        Case(np.diag([1.0, 2.0]), 0),
        Case(np.array([[1.0, 1.0], [1.0, 1.0]]), 1),
        Case(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-12]]), 1),
    ],
)
def test_a_factor_is_repaired_by_little_or_not_at_all(case):
    L, P, repairs = cholesky(case.P)
    assert repairs <= case.repairs
    np.testing.assert_allclose(L @ L.T, P, atol=1e-12)
    np.testing.assert_allclose(P, case.P, atol=1e-7)


@pytest.mark.parametrize('P', [np.diag([1.0, -1.0]), np.full((2, 2), np.nan)])
def test_what_is_no_covariance_is_not_repaired(P):
    with pytest.raises(np.linalg.LinAlgError):
        cholesky(P)


@pytest.mark.slow
@pytest.mark.parametrize('implementation', ['native', 'filterpy'])
@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_a_long_step_is_as_uncertain_as_many_short_ones_make_it(kind, implementation):
    if implementation == 'filterpy':
        pytest.importorskip('filterpy')
    model, runs, h = TurnRate(), 3000, 0.01
    mean = np.array([0.0, 0.0, 3.0, 0.3, 0.5])
    P = np.diag([0.1, 0.1, 0.1, 0.05, 0.05]) ** 2
    rng = np.random.default_rng(0)
    x = rng.multivariate_normal(mean, P, runs)
    for _ in range(200):
        x = model.step(x, np.zeros(0), h)
        x += rng.normal(size=x.shape) * np.sqrt(h * model.noise_density(mean).diagonal())
    filter = build_filter(kind, Plan(model, {}, 100.0), implementation=implementation)
    belief = filter.predict(Gaussian(mean, P), np.zeros(0), 200 * h)
    errors = model.state.subtract(x, belief.mean)
    assert 0.95 < nees(errors, np.tile(belief.covariance, (runs, 1, 1))).mean() / 5 < 1.1


@pytest.mark.parametrize('dt', [0.3, -0.3])
def test_a_long_step_of_either_sign_is_divided(dt):
    filter, u = build_filter('ekf', Plan(TurnRate(), {}, 100.0)), np.zeros(0)
    belief = Gaussian(np.array([1.0, 2.0, 3.0, 0.5, 0.4]), 0.1 * np.eye(5))
    one, other = filter.predict(belief, u, dt), filter.linearized(belief, u, dt).belief
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-12)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-12)


def test_a_short_step_is_one():
    model, u, dt = TurnRate(), np.zeros(0), TurnRate.max_step
    belief = Gaussian(np.array([0.0, 0.0, 3.0, 0.3, 0.5]), 0.01 * np.eye(5))
    F, Q = (getattr(model.transition(belief.mean, u, dt), name) for name in 'FQ')
    found = build_filter('ekf', Plan(model, {}, 100.0)).predict(belief, u, dt)
    np.testing.assert_array_equal(found.mean, model.step(belief.mean, u, dt))
    np.testing.assert_allclose(found.covariance, F @ belief.covariance @ F.T + Q, rtol=1e-14)
    assert parts(model, dt) == parts(model, -dt) == parts(model, dt * (1 + 1e-15)) == 1
    assert parts(model, 3 * dt * (1 + 1e-15)) == 3
    assert parts(model, 1.01 * dt) == parts(model, -1.01 * dt) == 2
    assert parts(model, 5000 * dt) == 100  # a long silence must not keep a node busy
    assert parts(model, 1e6) == 1  # beyond what the model resolves itself
    assert (
        parts(
            LinearSystem([[0.0]], np.zeros((1, 0)), [[1.0]], Space('x', ('',)), Space((), ())), 1e6
        )
        == 1
    )


class Square(Sensor):
    """y = x^2, the first function of which a linearisation has the wrong mean."""

    output, covariance = Space(('y',), ('',)), np.array([[0.25]])

    def measure(self, x):
        return x[..., :1] ** 2


@pytest.mark.parametrize(('alpha', 'beta'), [(1.0, 2.0), (0.5, 2.0), (0.5, 0.0), (1.0, 0.5)])
def test_beta_adds_what_the_fourth_moment_adds(alpha, beta):
    """Var x^2 = 4 m^2 s^2 + 2 s^4 for a Gaussian, with beta = 2 (van der Merwe, section 3.2.2)."""
    system = LinearSystem([[0.0]], np.zeros((1, 0)), [[1.0]], Space('x', ('',)), Space((), ()))
    filter = UnscentedKalmanFilter(system, alpha, beta, kappa=0.0)
    m, s = 1.5, 0.8
    correction = filter.correct(
        Gaussian(np.array([m]), np.array([[s**2]])), np.array([2.0]), Square()
    )
    assert correction.innovation[0] == pytest.approx(2.0 - (m**2 + s**2))
    expected = 4.0 * m**2 * s**2 + beta * s**4 + 0.25
    assert correction.innovation_covariance[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize('rate', [5.0, 10.0, 100.0])
def test_a_luenberger_gain_makes_up_for_a_slow_sensor(rate):
    """Each reading corrects for all of the time since the last one: L T, whatever the loop's."""
    values = {'model': 'level', 'reading.rate': rate, 'rate': 100.0}
    plan = scenario.build(values).plan
    observer = build_filter('luenberger', plan, {'observer_poles': [-2.0]})
    np.testing.assert_allclose(observer.gains['reading'], [[2.0 / rate]])
    # so the error dies out with the pole, at any rate of readings
    error, sensor = Gaussian(np.array([1.0]), np.eye(1)), plan.sensors['reading'].sensor
    for _ in range(round(rate)):
        error = observer.predict(error, np.zeros(0), 1.0 / rate)
        error = observer.correct(error, np.zeros(1), sensor).posterior
    assert error.mean[0] == pytest.approx(np.exp(-2.0), rel=5.0 / rate)


def test_what_is_certain_has_a_factor():
    P = np.array([[4.0, 0.0, 2.0], [0.0, 0.0, 0.0], [2.0, 0.0, 2.0]])
    L, same, repairs = cholesky(P)
    np.testing.assert_allclose(L @ L.T, P, atol=1e-15)
    assert (np.tril(L) == L).all()
    assert same is P
    assert repairs == 0
    L, _, repairs = cholesky(np.zeros((3, 3)))
    assert not L.any()
    assert repairs == 0
    nearly = np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0 - 1e-15]])
    L, repaired, repairs = cholesky(nearly)
    assert repairs == 1
    assert not repaired[1].any()
    np.testing.assert_allclose(L @ L.T, repaired, atol=1e-15)
    for wrong in (np.array([[0.0, 1.0], [1.0, 1.0]]), np.diag([0.0, -1.0])):
        with pytest.raises(np.linalg.LinAlgError):
            cholesky(wrong)
