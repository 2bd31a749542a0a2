# SPDX-License-Identifier: Apache-2.0
"""Starts from infinite variances: least squares on the readings alone, and published numbers."""

import pickle

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.diffuse import Diffuse, begun, known_part, settled, update
from kalman_ros.estimators.filter import committed
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.timeline import Arrival

N, K, STEPS, DT = 3, 2, 6, 0.2
NOWHERE = (np.zeros(N), np.full(N, np.inf))


def system(seed=0, *, correlated=True):
    """Return a random model and a sensor with K numbers, whose noise is correlated."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(N, N)) - 1.5 * np.eye(N)
    root = rng.normal(size=(K, K)) + np.eye(K)
    R = root @ root.T if correlated else np.diag(rng.uniform(0.5, 2.0, K))
    model = kr.continuous_model(A, W=np.diag(rng.uniform(0.1, 1.0, N)))
    return model, (rng.normal(size=(K, N)), R)


def readings(seed=0):
    return np.random.default_rng(seed + 100).normal(size=(STEPS, K))


def least_squares(model, sensor, y, count, first=None):
    """Return the mean and covariance of all states (STEPS * N) by generalised least squares.

    The unknowns are the states at all steps. Rows are the steps of the model, the first ``count``
    readings, and where there is one, the ``first`` belief about some states (indices, mean,
    variances).
    """
    H, R = sensor
    F, _, Q = model.sampled(DT)
    size, rows, right, weights = N * STEPS, [], [], []
    for k in range(STEPS - 1):
        row = np.zeros((N, size))
        row[:, N * (k + 1) : N * (k + 2)], row[:, N * k : N * (k + 1)] = np.eye(N), -F
        rows.append(row), right.append(np.zeros(N)), weights.append(np.linalg.inv(Q))
    for k in range(count):
        row = np.zeros((K, size))
        row[:, N * k : N * (k + 1)] = H
        rows.append(row), right.append(y[k]), weights.append(np.linalg.inv(R))
    if first is not None:
        indices, mean, variances = first
        row = np.zeros((len(indices), size))
        row[np.arange(len(indices)), indices] = 1.0
        rows.append(row), right.append(mean), weights.append(np.diag(1.0 / variances))
    information = sum(row.T @ W @ row for row, W in zip(rows, weights))
    vector = sum(row.T @ W @ b for row, W, b in zip(rows, weights, right))
    P = np.linalg.inv(information)
    return P @ vector, P


def at(found, k):
    x, P = found
    part = slice(N * k, N * (k + 1))
    return x[part], P[part, part]


@pytest.mark.parametrize('filter', ['kf', 'ekf'])
@pytest.mark.parametrize('correlated', [True, False])
@pytest.mark.parametrize('seed', range(3))
def test_it_is_least_squares_on_the_readings_alone(seed, correlated, filter):
    model, sensor = system(seed, correlated=correlated)
    y = readings(seed)
    found = kr.filter(model, sensor, DT * np.arange(STEPS), y, initial=NOWHERE, filter=filter)
    # two readings of two numbers determine three states
    assert np.isinf(found.std[0]).any()
    assert np.isfinite(found.covariance[1:]).all()
    for k in range(1, STEPS):
        x, P = at(least_squares(model, sensor, y, k + 1), k)
        np.testing.assert_allclose(found.mean[k], x, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(found.covariance[k], P, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize('unknown', [[0], [1, 2], [0, 1, 2]])
def test_some_states_may_be_known(unknown):
    model, sensor = system(3)
    y, known = readings(3), [i for i in range(N) if i not in unknown]
    variances, mean = np.array([0.3, 0.5, 0.7]), np.array([1.0, -1.0, 2.0])
    P = np.where(np.isin(np.arange(N), unknown), np.inf, variances)
    found = kr.filter(model, sensor, DT * np.arange(STEPS), y, initial=(mean, P))
    first = known, mean[known], variances[known]
    for k in range(1, STEPS):
        x, P = at(least_squares(model, sensor, y, k + 1, first), k)
        np.testing.assert_allclose(found.mean[k], x, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(found.covariance[k], P, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize('seed', range(3))
def test_smoothed_states_are_least_squares_on_all_readings(seed):
    model, sensor = system(seed)
    y = readings(seed)
    found = kr.filter(model, sensor, DT * np.arange(STEPS), y, initial=NOWHERE)
    smoothed, whole = kr.smooth(found), least_squares(model, sensor, y, STEPS)
    for k in range(STEPS):
        x, P = at(whole, k)
        np.testing.assert_allclose(smoothed.mean[k], x, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(smoothed.covariance[k], P, rtol=1e-6, atol=1e-6)


def test_what_no_reading_determines_stays_unknown():
    model = kr.continuous_model(np.zeros((2, 2)), W=np.ones(2))
    found = kr.filter(model, ([1.0, 0.0], 1.0), [0, 1, 2], [3.0, 4.0, 5.0], initial='diffuse')
    assert np.isfinite(found.std[:, 0]).all() and np.isinf(found.std[:, 1]).all()
    assert found.mean[:, 1].tolist() == [0.0, 0.0, 0.0]
    # the first reading is certain to be right
    assert next(iter(found.innovations.values())).values[0] == 0.0
    smoothed = kr.smooth(found)
    assert np.isinf(smoothed.std[:, 1]).all()
    assert 'inf' in repr(found)


def test_the_likelihood_is_that_of_large_variances_in_the_limit():
    """Up to 1/2 log(2 pi c) for each state that is unknown."""
    model, sensor = system(5)
    y, times = readings(5), DT * np.arange(STEPS)
    exact = kr.filter(model, sensor, times, y, initial=NOWHERE).log_likelihood
    errors = []
    for c in (1e4, 1e5, 1e6):
        near = kr.filter(model, sensor, times, y, initial=(np.zeros(N), c)).log_likelihood
        errors.append(abs(near + 0.5 * N * np.log(2.0 * np.pi * c) - exact))
    assert errors[2] < 1e-3 and errors[0] / errors[1] == pytest.approx(10.0, rel=0.1)


def test_members_of_a_batch_are_as_alone():
    rng = np.random.default_rng(7)
    unknown = np.stack([np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 1.0, 1.0]), np.zeros((3, 3))])
    x, H, R = rng.normal(size=(3, N)), rng.normal(size=(3, K, N)), np.diag([0.5, 2.0])
    known, nu = np.stack([np.eye(3) - U for U in unknown]), rng.normal(size=(3, K))
    whole = update(Diffuse(x, known, unknown), nu, H, R)
    for k in range(3):
        alone = update(Diffuse(x[k], known[k], unknown[k]), nu[k], H[k], R)
        for together, single in zip(whole, alone):
            np.testing.assert_allclose(together[k], single, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(whole.change, (whole.gain @ nu[..., None])[..., 0], rtol=1e-12)


def estimator(model, sensor, initial=NOWHERE):
    built = kr.make_scenario(model, {'a': sensor, 'b': sensor}, rate=1.0 / DT)
    sensors = {name: source.sensor for name, source in built.sensors.items()}
    plan = Plan(model, {name: TimedSensor(s, 1.0) for name, s in sensors.items()}, 1.0)
    first = Gaussian(initial[0], np.diag(initial[1]))
    return OnlineEstimator(
        build_filter('kf', plan), sensors, first, np.zeros(0), Policy(window=10.0)
    )


def test_late_readings_are_fused_in_their_place_before_anything_is_known():
    model, sensor = system(2)
    y = readings(2)
    arrivals = [Arrival('ab'[k % 2], round(k * DT * 1e9), y[k]) for k in range(STEPS)]
    straight, shuffled = estimator(model, sensor), estimator(model, sensor)
    straight.add(arrivals)
    for k in (3, 0, 5, 1, 4, 2):
        shuffled.add([arrivals[k]])
    for one, other in zip(straight.belief, shuffled.belief):
        np.testing.assert_array_equal(one, other)
    assert type(straight.belief) is Gaussian
    straight.reset(Gaussian(NOWHERE[0], np.diag(NOWHERE[1])))
    straight.add(arrivals[:1])
    assert isinstance(straight.belief, Diffuse)
    ahead = straight.predicted(round(DT * 1e9))
    assert isinstance(ahead, Diffuse) and np.isinf(ahead.covariance).any()


def test_gates_judge_what_something_is_known_of():
    model = kr.continuous_model(np.zeros((1, 1)), W=[0.01])
    times, y = np.arange(6.0), np.array([1e6, 1e6, 1e6, 0.0, 1e6, 1e6])
    found = kr.filter(model, ([1.0], 1.0), times, y, initial='diffuse', gates=0.999)
    assert next(iter(found.counts.values())) == {'fused': 5, 'rejected: outside the gate': 1}


def test_a_belief_is_a_belief():
    plain = Gaussian(np.zeros(2), np.diag([np.inf, 2.0]))
    belief = begun(plain)
    assert begun(belief) is belief and begun(known_part(belief)).covariance[1, 1] == 2.0
    again = pickle.loads(pickle.dumps(belief))
    for one, other in zip(
        (*belief, belief.known, belief.unknown), (*again, again.known, again.unknown)
    ):
        np.testing.assert_array_equal(one, other)
    assert committed(belief) == (belief, 0)
    assert type(belief._replace(mean=np.ones(2))) is Gaussian
    assert type(settled(belief.mean, belief.known, np.zeros((2, 2)))) is Gaussian
    np.testing.assert_array_equal(belief.covariance, np.diag([np.inf, 2.0]))
    turned = Diffuse(np.zeros(2), np.eye(2), np.array([[1.0, -1.0], [-1.0, 1.0]]))
    np.testing.assert_array_equal(turned.covariance, [[np.inf, -np.inf], [-np.inf, np.inf]])


@pytest.mark.parametrize('filter', ['ukf', 'square_root', 'gaussian_sum', 'steady_state'])
def test_other_filters_refuse_it_in_one_line(filter):
    model, sensor = system()
    with pytest.raises(ValueError, match='^initial: a start from infinite .* expected kf or ekf'):
        kr.filter(model, sensor, DT * np.arange(STEPS), readings(), initial=NOWHERE, filter=filter)


@pytest.mark.parametrize('P', [[np.inf, 1.0, -np.inf], [np.nan, 1.0, 1.0], -np.inf])
def test_a_variance_is_no_other_infinity(P):
    model, sensor = system()
    with pytest.raises(ValueError, match='^initial covariance: '):
        kr.filter(model, sensor, DT * np.arange(STEPS), readings(), initial=(np.zeros(N), P))


def test_in_a_loop_of_ones_own():
    model, (H, R) = system()
    y = readings()
    filter = kr.KalmanFilter(model)
    belief = Gaussian(np.zeros(N), np.diag(np.full(N, np.inf)))
    for k in range(STEPS):
        if k:
            belief = filter.predict(belief, dt=DT)
        belief = filter.correct(belief, y[k], (H, R)).posterior
    whole = kr.filter(model, (H, R), DT * np.arange(STEPS), y, initial='diffuse')
    np.testing.assert_allclose(belief.mean, whole.mean[-1], rtol=1e-9)


@pytest.mark.parametrize(
    ('name', 'state', 'what'),
    [
        ('lidar_radar', 'x', 'radar'),
        ('gnss_imu', 'psi', 'the model'),
        ('inertial', 'z', 'barometer'),
        ('robot_3d', 'rz', 'imu'),
    ],
)
def test_a_state_about_which_something_is_linearised_has_to_be_known(name, state, what):
    robot = kr.load(name)
    run = kr.simulate(name, seconds=1, seed=1)
    mean, P = robot.initial_belief.mean, robot.initial_belief.covariance.diagonal().copy()
    P[robot.model.state.names.index(state)] = np.inf
    said = f'^initial: expected finite numbers for what {what} is not linear in, .* for {state}$'
    with pytest.raises(ValueError, match=said):
        kr.filter(robot, None, *rows_of(run), initial=(mean, P), filter='ekf')


def rows_of(run):
    """Return the times and the values of all readings, by sensor."""
    times = {name: each.time for name, each in run.readings.items()}
    return times, {name: each.values for name, each in run.readings.items()}


@pytest.mark.slow
@pytest.mark.parametrize('name', ['inertial', 'robot_3d'])
def test_a_place_in_space_may_be_unknown(name):
    robot = kr.load(name)
    run = kr.simulate(name, seconds=2, seed=1)
    given = {'inputs': run.input, 'input_times': run.time} if robot.model.input.size else {}
    P = robot.initial_belief.covariance.diagonal().copy()
    found = []
    for variance in (1e8, np.inf):
        P[:2] = variance
        start = (robot.initial_belief.mean, P)
        found.append(kr.filter(robot, None, *rows_of(run), initial=start, filter='ekf', **given))
    near, exact = found
    known = np.isfinite(exact.std).all(axis=1)
    assert known[-1] and (np.diff(known.astype(int)) >= 0).all()
    np.testing.assert_allclose(exact.mean[-1], near.mean[-1], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(exact.std[-1], near.std[-1], rtol=1e-3)


def test_what_hardly_shows_is_not_taken_for_known():
    """An acceleration moves the third of readings 10 ms apart by 1e-4 of it."""
    A = np.diag([1.0, 1.0, 1.0], 1)[:4, :4]
    model = kr.continuous_model(A, W=np.array([0.0, 0.0, 0.0, 1e-6]))
    times = 0.01 * np.arange(8)
    truth = 2.0 + 3.0 * times + 2.5 * times**2 + 7.0 / 6.0 * times**3
    found = kr.filter(model, ([1.0, 0.0, 0.0, 0.0], 1e-18), times, truth, initial='diffuse')
    assert np.isinf(found.std[2]).any() and np.isfinite(found.std[3:]).all()
    now = times[-1]
    expected = [truth[-1], 3.0 + 5.0 * now + 3.5 * now**2, 5.0 + 7.0 * now, 7.0]
    np.testing.assert_allclose(found.mean[-1], expected, rtol=1e-3)
    assert (found.covariance[-1].diagonal() > 0.0).all()


def test_readings_of_which_nothing_was_known_are_not_judged():
    model, sensor = system(4)
    times, truth = DT * np.arange(60), np.zeros((60, N))
    F, _, Q = model.sampled(DT)
    rng = np.random.default_rng(4)
    for k in range(1, 60):
        truth[k] = F @ truth[k - 1] + np.linalg.cholesky(Q) @ rng.normal(size=N)
    H, R = sensor
    y = truth @ np.transpose(H) + rng.normal(size=(60, K)) @ np.linalg.cholesky(R).T
    found = kr.filter(model, sensor, times, y, initial='diffuse')
    assert np.isnan(found.nis[:2]).all() and np.isfinite(found.nis[2:]).all()
    assert found.degrees.tolist() == [0, 0, *[K] * 58]
    report = kr.consistency(found, truth)
    assert report.passed
    assert [check.count for check in report.checks] == [59, 58]


def test_a_nan_is_no_infinity():
    model, sensor = system()
    P = np.diag([np.inf, 1.0, 1.0])
    P[0, 1] = P[1, 0] = np.nan
    with pytest.raises(ValueError, match='^initial covariance: expected numbers, got NaN'):
        kr.filter(model, sensor, [0.0], [[1.0, 1.0]], initial=(np.zeros(N), P))
