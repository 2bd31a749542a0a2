# SPDX-License-Identifier: Apache-2.0
"""Filters, an estimator and a regulator in a loop of one's own: the same as in the nodes."""

import math

import numpy as np
import pytest

import kalman_ros as kr

DT = 0.05
LINEAR = kr.continuous_model([[0, 1], [-2, -0.5]], [[0], [1]], [0, 0.1])
GPS = kr.sensor([1, 0], 0.05**2, name='gps')
CART = kr.load('cart_pole').model
ENCODERS = kr.sensor([[1, 0, 0, 0], [0, 0, 1, 0]], [1e-4, 1e-4])
START = kr.Gaussian(np.zeros(4), 0.01 * np.eye(4))
EKF = kr.ExtendedKalmanFilter(CART)


def by_hand(filter, belief, readings, inputs, sensor):
    """Return the beliefs after each reading, one every DT, with the inputs held from there."""
    found = []
    for y, u in zip(readings, inputs):
        if np.isfinite(y).all():
            belief = filter.correct(belief, y, sensor).posterior
        found.append(belief)
        belief = filter.predict(belief, u, DT)
    return found


@pytest.mark.parametrize(
    ('kind', 'name', 'model', 'sensor'),
    [
        (kr.KalmanFilter, 'kf', LINEAR, GPS),
        (kr.ExtendedKalmanFilter, 'ekf', CART, ENCODERS),
        (kr.UnscentedKalmanFilter, 'ukf', CART, ENCODERS),
    ],
)
def test_steps_by_hand_are_those_of_the_whole_recording(kind, name, model, sensor):
    rng, N, n = np.random.default_rng(2), 40, model.state.size
    readings = 0.05 * rng.standard_normal((N, sensor.output.size))
    readings[10:14] = np.nan
    inputs = rng.standard_normal((N, 1))
    start = kr.Gaussian(np.zeros(n), 0.01 * np.eye(n))
    found = by_hand(kind(model), start, readings, inputs, sensor)
    whole = kr.filter(model, sensor, np.arange(N) * DT, readings, inputs, start, filter=name)
    np.testing.assert_allclose([b.mean for b in found], whole.mean, atol=1e-12)
    np.testing.assert_allclose([b.covariance for b in found], whole.covariance, atol=1e-14)


def test_a_kalman_filter_is_that_of_filterpy():
    kalman = pytest.importorskip('filterpy.kalman')
    peer, step = kalman.KalmanFilter(2, 1, 1), LINEAR.sampled(DT)
    peer.F, peer.B, peer.Q, peer.H, peer.R = step.F, step.G, step.Q, [[1, 0]], [[0.05**2]]
    peer.x, peer.P = np.zeros(2), np.eye(2)
    peer.H = np.array(peer.H)
    belief, kf = kr.Gaussian(np.zeros(2), np.eye(2)), kr.KalmanFilter(LINEAR)
    for y, u in np.random.default_rng(4).standard_normal((20, 2)):
        peer.predict(np.array([u]))
        peer.update(y)
        belief = kf.correct(kf.predict(belief, u, DT), y, GPS).posterior
        np.testing.assert_allclose(belief.mean, peer.x, rtol=1e-9)
        np.testing.assert_allclose(belief.covariance, peer.P, rtol=1e-9)


def test_arguments_may_be_lists_numbers_and_pairs():
    kf = kr.KalmanFilter(LINEAR)
    exact = kf.predict(kr.Gaussian([1.0, 2.0], np.diag([0.1, 0.2])), np.array([3.0]), 0.1)
    loose = kf.predict(([1, 2], [0.1, 0.2]), 3, 0.1)
    assert np.array_equal(loose.mean, exact.mean)
    assert np.array_equal(loose.covariance, exact.covariance)
    sensor = kf.correct(exact, np.array([1.0]), kr.sensor([[1.0, 0.0]], 0.3)).posterior
    pair = kf.correct(exact, 1, ([1, 0], 0.3)).posterior
    assert np.array_equal(pair.mean, sensor.mean)
    np.testing.assert_allclose(kf.predict(exact, dt=0.0).covariance, exact.covariance)
    sampled = kr.discrete_model([[1, 1], [0, 1]], [0, 1], [0, 0.1], period=0.5)
    assert kr.KalmanFilter(sampled).predict(([0, 1], 1)).mean[0] == 1.0


def test_the_regulator_is_that_of_the_simulated_loop():
    run = kr.simulate(
        'cart_pole', seconds=1.0, seed=3, reference={'x': 0.3}, input_limit=2.0,
        input_rate_limit=500.0,
    )  # fmt: skip
    law = kr.Regulator('cart_pole', reference={'x': 0.3}, input_limit=2.0, input_rate_limit=500.0)
    inputs = [law.step(x) for x in run.estimate[: len(run.input)]]
    np.testing.assert_allclose(inputs, run.input[: len(inputs)], atol=1e-9)
    assert law.limited > 0
    assert np.array_equal(law.input, inputs[-1])
    law.hold(None)
    assert not law.target.any()
    assert law.dt == 0.01
    assert law.gain.shape == (1, 4)
    text = str(law)
    assert text.startswith('lqr of CartPole, 100 Hz, K =')
    assert max(map(len, text.splitlines())) <= 80


def test_a_reference_that_is_refused_leaves_the_last_one():
    law = kr.Regulator('cart_pole', reference={'x': 0.3})
    with pytest.raises(ValueError, match=r'^reference: no input holds the system at v = 1'):
        law.hold({'v': 1.0})
    with pytest.raises(ValueError, match=r'^reference: no input holds the system at v = 1'):
        law.hold(lambda time: {'v': 1.0})
    assert law.target[0] == pytest.approx(0.3)
    before = law.step(np.zeros(4))
    with pytest.raises(ValueError, match=r'^estimate: expected finite numbers, got \[nan'):
        law.step([np.nan, 0, 0, 0])
    assert np.array_equal(law.step(np.zeros(4)), before)


def test_readings_in_any_order_give_one_estimate():
    times, rng = np.arange(20) * DT, np.random.default_rng(5)
    readings = 0.02 * rng.standard_normal((20, 2))
    ordered, shuffled = (kr.OnlineEstimator(EKF, ENCODERS, START, window=2.0) for _ in range(2))
    for each, order in ((ordered, range(20)), (shuffled, [0, *(1 + rng.permutation(19))])):
        each.add_input(0.0, 0.5)
        for k in order:
            outcome, _ = each.add_reading(times[k], readings[k])
            assert outcome.accepted
    assert np.array_equal(ordered.belief.mean, shuffled.belief.mean)
    assert ordered.time == pytest.approx(0.95)
    whole = kr.filter(CART, ENCODERS, times, readings, 0.5, START, arithmetic='numpy')
    np.testing.assert_allclose(ordered.belief.mean, whole.mean[-1], atol=1e-12)


def test_each_reading_has_an_outcome_and_none_that_is_bad_moves_the_belief():
    estimator = kr.OnlineEstimator(EKF, {'encoders': ENCODERS}, START, gates=0.999)
    estimator.add_reading(0.0, [0.0, 0.01])
    before = estimator.belief
    for time, y, words in (
        (0.0, [0.0, 0.01], 'dropped: duplicate stamp'),
        (0.0, [np.inf, 0.0], 'dropped: not finite'),
        (0.0, [1.0], 'dropped: wrong size'),
        (-5.0, [0.0, 0.0], 'dropped: older than the window'),
    ):
        assert estimator.add_reading(time, y)[0].value == words
        assert estimator.belief is before
    outcome, correction = estimator.add_reading(0.01, [5.0, 0.0])
    assert outcome.value == 'rejected: outside the gate'
    assert correction.nis > 100.0
    assert estimator.add_reading(0.02, [5.0, 0.0], covariance=100.0)[0].accepted
    assert estimator.counts['encoders']['fused'] == 2
    assert sum(estimator.counts['encoders'].values()) == 7
    text = str(estimator)
    assert text.startswith('ExtendedKalmanFilter of CartPole in time, at 0.02 s\nx [m] ')
    estimator.reset(START)
    assert estimator.time is None


@pytest.mark.slow
def test_a_compiled_model_gives_the_same_numbers(monkeypatch, tmp_path):
    pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
    monkeypatch.delenv('KALMAN_ROS_ARITHMETIC')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    fast = kr.ExtendedKalmanFilter(kr.compile(CART))
    assert fast.model.arithmetic == 'C'
    mine, theirs = (each.predict(START, 0.5, DT) for each in (fast, EKF))
    np.testing.assert_allclose(mine.mean, theirs.mean, atol=1e-12)
    np.testing.assert_allclose(mine.covariance, theirs.covariance, atol=1e-12)
    gps = kr.compile(GPS, LINEAR.state)  # whose numbers C has
    assert gps.arithmetic == 'numpy'
    np.testing.assert_array_equal(gps.jacobian(START.mean[:2]), GPS.jacobian(START.mean[:2]))


REGULATOR = kr.Regulator('cart_pole')
ONLINE = kr.OnlineEstimator(EKF, ENCODERS, START)
HELPED = [
    (lambda: kr.KalmanFilter(CART), 'filter: kf needs a linear model, got CartPole'),
    (lambda: kr.ExtendedKalmanFilter('cart_pole'), "model: expected a model, got 'cart_pole'"),
    (lambda: kr.UnscentedKalmanFilter(CART, kappa=-5), 'kappa: expected more than -4, got -5'),
    (lambda: EKF.predict(START), 'dt: expected a number of seconds, got nothing'),
    (lambda: EKF.predict(START, 0, -1), 'dt: expected a number of seconds from 0, got -1'),
    (lambda: EKF.predict(START, [1, 2], 1), 'u: expected 1 numbers, got 2'),
    (lambda: EKF.predict(3, 0, 1), 'belief: expected a Gaussian or a pair of mean and cov'),
    (lambda: EKF.predict(([0, 0], 1), 0, 1), 'belief mean: expected 4 numbers, got 2'),
    (lambda: EKF.correct(START, [1], ENCODERS), 'y: expected 2 numbers, got 1'),
    (lambda: EKF.correct(START, [1, np.nan], ENCODERS), 'y: expected finite numbers, got [1.0, n'),
    (lambda: EKF.correct(START, [1, 1j], ENCODERS), 'y: expected real numbers'),
    (lambda: EKF.correct(START, [1, 2], 3), 'sensors: expected a sensor, a pair (H, R)'),
    (
        lambda: kr.KalmanFilter(LINEAR).correct(([0, 0], 1), 0, kr.sensor(lambda x: x[:1], 1)),
        'sensor: a Kalman filter needs a linear one',
    ),
    (lambda: kr.OnlineEstimator(CART, ENCODERS, START), 'filter: expected one such as kr.Ext'),
    (lambda: kr.OnlineEstimator(EKF, ENCODERS, START, window=-1), 'window: expected a number of'),
    (lambda: kr.OnlineEstimator(EKF, ENCODERS, START, gates=2), 'gates: expected a probability'),
    (lambda: ONLINE.add_reading(0, [0, 0], 'gps'), "sensor: expected one of y, got 'gps'"),
    (lambda: ONLINE.add_reading(np.nan, [0, 0]), 'time: expected a number of seconds, got nan'),
    (lambda: ONLINE.add_input(0, np.nan), 'input: expected finite numbers, got [nan]'),
    (lambda: kr.compile(3), 'part: expected a model or a sensor, got 3'),
    (lambda: kr.compile(ENCODERS), 'state: expected the space of the states that the sensor'),
    (lambda: REGULATOR.step([1, 2]), 'estimate: expected 4 numbers, got 2'),
    (lambda: REGULATOR.step(np.zeros(4), 0), 'dt: expected a positive number of seconds, got 0'),
    (lambda: REGULATOR.hold({'z': 1}), "reference: expected names among (x, v, theta, omega), go"),
    (lambda: kr.Regulator('diff_drive'), 'model: it has no input, so there is nothing to regul'),
]  # fmt: skip


@pytest.mark.parametrize(('call', 'words'), HELPED)
def test_a_wrong_argument_is_named_in_one_line(call, words):
    with pytest.raises(ValueError) as error:
        call()
    assert str(error.value).startswith(words)
    assert '\n' not in str(error.value)


def test_results_print_in_one_line():
    found = EKF.correct(START, [0.1, 0.0], ENCODERS)
    assert repr(found).startswith('Correction(innovation [0.1 0. ], NIS 0.99')
    assert '\n' not in repr(found)


@pytest.mark.parametrize('name', ['KalmanFilter', 'ExtendedKalmanFilter', 'UnscentedKalmanFilter'])
def test_the_arguments_of_filterpy_are_answered_with_ours(name):
    with pytest.raises(TypeError, match=f'^{name}: filterpy has dim_x and dim_z, here'):
        getattr(kr, name)(dim_x=2, dim_z=1)


@pytest.mark.parametrize('name', ['KalmanFilter', 'ExtendedKalmanFilter', 'UnscentedKalmanFilter'])
def test_matrices_in_place_of_a_model_are_answered_with_the_model(name):
    with pytest.raises(TypeError, match=f'^{name}: expected a model, got matrices: kr.{name}'):
        getattr(kr, name)(np.eye(2), np.eye(1, 2), np.eye(2), np.eye(1))


@pytest.mark.parametrize(
    ('name', 'here'),
    [('x', '.mean'), ('P', '.covariance'), ('cov', '.covariance'), ('sigma', '.std')],
)
def test_a_belief_names_what_others_call_otherwise(name, here):
    with pytest.raises(AttributeError, match=f"^Gaussian has no '{name}'; here it is {here}$"):
        getattr(START, name)
    with pytest.raises(AttributeError, match=r"^Gaussian has no 'nope'; it has covariance, fac"):
        assert START.nope


@pytest.mark.parametrize(
    ('name', 'here'), [('x', '.posterior.mean'), ('K', '.gain'), ('S', '.innovation_covariance')]
)
def test_a_correction_names_what_others_call_otherwise(name, here):
    found = EKF.correct(START, [0.1, 0.0], ENCODERS)
    with pytest.raises(AttributeError, match=f"^Correction has no '{name}'; here it is {here}$"):
        getattr(found, name)


def norm(x):
    return np.linalg.norm(x)


A2 = np.array([[0.0, 1.0], [-1.0, -0.2]])
#: Functions of a state of two numbers, and an input, as people write them.
OF_TWO = [
    lambda x, u: np.array([x[1], np.sin(x[0]) + u[0]]),
    lambda x, u: [x[1], math.sin(x[0]) + u[0]],
    lambda x, u: np.stack((x[..., 1], np.sin(x[..., 0]) + u[..., 0]), axis=-1),
    lambda x, u: A2 @ x + u / max(1.0, norm(u) / 5.0),
    lambda x, u: np.array([x[1], -x[0]]) / max(1.0, norm(x) / 8.0),
    lambda x, u: x / max(1.0, norm(x) / 8.0) + u,
    lambda x, u: -x if np.any(x < 0) else x,
    lambda x, u: np.sign(np.sum(x)) * np.array([x[1], -x[0]]),
    lambda x, u: x * min(1.0, 8.0 / np.abs(x).max()),
    lambda x, u: 1e-10 * np.array([x[1] * x.sum(), -x[0]]),
    lambda x, u: -x / len(x) + np.zeros(2),
    lambda x, u: np.array([x[1], -x[0]]) if np.all(x < 4.0) else x,
]
#: The same of three.
OF_THREE = [
    lambda x, u: -x / len(x),
    lambda x, u: [-x[0], -x[1], -x[2]],
    lambda x, u: -0.5 * np.eye(3) @ x + np.zeros(3),
    lambda x, u: np.cross(x, [0.1, 0.2, 0.3]),
    lambda x, u: x[:3] * x[..., :1],
]


@pytest.mark.parametrize('count', [1, 2, 3, 7, 11, 20])
@pytest.mark.parametrize(('f', 'n'), [*((f, 2) for f in OF_TWO), *((f, 3) for f in OF_THREE)])
def test_a_function_of_many_points_is_that_of_each(f, n, count):
    model = kr.continuous_model(f, W=[0.1] * n, states=n, inputs='u')
    x = 10.0 * np.random.default_rng(count).normal(size=(count, n))
    u = np.linspace(-20.0, 20.0, count)[:, np.newaxis]
    found = model.derivative(x, u)
    expected = [np.asarray(f(a, b), dtype=float) for a, b in zip(x, u)]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_what_takes_many_points_is_called_once():
    count = []

    def counted(x, u):
        count.append(1)
        return np.stack((x[..., 1], np.sin(x[..., 0]) + u[..., 0]), axis=-1)

    model = kr.continuous_model(counted, W=[0.1, 0.1], states='p q', inputs='u')
    count.clear()
    model.derivative(np.ones((3, 4, 2)), np.ones(1))
    assert len(count) == 1


def test_what_a_function_does_to_its_arrays_is_seen_nowhere_else():
    result = np.zeros(2)

    def reused(x, u):
        result[0], result[1] = x[1], -x[0] + u[0]
        return result

    def clipped(x, u):
        x[1] = np.clip(x[1], -0.3, 0.3)
        return [x[1], -x[0] + u[0]]

    def plain(x, u):
        return [x[1], -x[0] + u[0]]

    x, u = np.array([[2.0, 0.1], [-1.0, 0.2]]), np.array([0.5])
    for f in (reused, clipped):
        model = kr.continuous_model(f, W=[0.1, 0.1], states='p q', inputs='u')
        expected = kr.continuous_model(plain, W=[0.1, 0.1], states='p q', inputs='u')
        given = x.copy()
        np.testing.assert_allclose(model.derivative(given, u), expected.derivative(x, u))
        np.testing.assert_array_equal(given, x)
        point = [2.0, 0.1], [0.5]
        np.testing.assert_allclose(
            kr.linearize(model, point).A, kr.linearize(expected, point).A, atol=1e-6
        )
