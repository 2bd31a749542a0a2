# SPDX-License-Identifier: Apache-2.0
"""Linear systems in C: beliefs are predicted and corrected as in numpy, one at a time."""

import pickle
from functools import lru_cache

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import Gaussian, LinearSystem, Sensor, Space
from kalman_ros.estimators.arrivals import Arrivals
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.sensors.linear import Linear
from kalman_ros.sensors.states import States

pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
from kalman_ros.compiled import attempt, library
from kalman_ros.compiled.native_linear import MOST_STATES, NativeLinearSystem
from kalman_ros.compiled.parts import parts

pytestmark = pytest.mark.slow  # the compiler is another process
#: Numbers of states and inputs: with an input and without one, and with wide registers.
SIZES = (1, 0), (3, 1), (8, 2)


@pytest.fixture(autouse=True)
def _compiled(monkeypatch):
    monkeypatch.delenv('KALMAN_ROS_ARITHMETIC', raising=False)


@lru_cache
def space(n, angles=()):
    return Space(tuple(f'x{i}' for i in range(n)), angles=angles)


def system(n, m, seed, rate=1.0, angles=()):
    """Return a random system that decays, with poles up to ``rate`` in 1/s."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A = rate * (A / np.abs(A).sum(axis=1).max() - 1.1 * np.eye(n))
    root = rng.standard_normal((n, n))
    inputs = Space(tuple(f'u{i}' for i in range(m)))
    return LinearSystem(A, rng.standard_normal((n, m)), root @ root.T, space(n, angles), inputs)


def belief_of(n, seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    return Gaussian(3.0 * rng.standard_normal(n), root @ root.T + 0.1 * np.eye(n))


def assert_same(mine, theirs, close=1e-12):
    for a, b in zip(mine, theirs):
        np.testing.assert_allclose(a, b, rtol=close, atol=close * np.abs(b).max(initial=1e-300))


@pytest.mark.parametrize(('n', 'm'), SIZES)
@pytest.mark.parametrize('kind', [KalmanFilter, ExtendedKalmanFilter])
def test_a_step_of_any_length_is_that_of_numpy(n, m, kind):
    for rate in (1e-2, 1.0, 30.0, 1e4):
        plain = system(n, m, seed=n, rate=rate)
        fast = attempt(plain).result
        assert isinstance(fast, NativeLinearSystem)
        u = np.random.default_rng(m).standard_normal(m)
        for dt in (0.0, 1e-9, 1e-3, 0.0123, 0.5, 7.0):  # up to 2^17 parts, which numpy takes
            before = belief_of(n, seed=1)
            assert_same(kind(fast).predict(before, u, dt), kind(plain).predict(before, u, dt))


def test_an_integrator_keeps_the_small_numbers_of_its_noise():
    """The variance of the position is 1e-18 of that of the velocity; each has all its digits."""
    inputs = Space(())
    A, W = [[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]
    plain = LinearSystem(A, np.zeros((2, 0)), W, space(2), inputs)
    fast, dt = attempt(plain).result, 1e-9
    exactly = np.zeros((2, 2)), np.zeros(0)
    Q = fast.predicted_moments(np.zeros(2), *exactly, dt).covariance
    exact = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    np.testing.assert_allclose(Q, exact, rtol=1e-14)


def test_slow_modes_whose_units_make_a_step_long_keep_their_digits():
    """Halved until it is short by its norm, the step differs from 1 by 1e-14."""
    A, W = np.array([[-1e-8, 1e6], [0.0, -1e-8]]), np.eye(2)
    plain = LinearSystem(A, np.zeros((2, 0)), W, space(2), Space(()))
    fast, before = attempt(plain).result, Gaussian([1.0, 0.0], np.eye(2))
    for model in (plain, fast):
        assert model.sampled(1.0).F[0, 0] - 1.0 == pytest.approx(-1e-8, rel=1e-6)
        after = KalmanFilter(model).predict(before, np.zeros(0), 1.0)
        assert after.mean[0] - 1.0 == pytest.approx(-1e-8, rel=1e-6)


def test_an_angle_is_wrapped_by_a_step_of_any_filter_and_arithmetic():
    plain = system(2, 1, seed=3, rate=1e-3, angles=('x0',))
    u, before = np.array([400.0]), Gaussian([3.1, 0.0], np.eye(2))
    beliefs = [
        kind(model).predict(before, u, 0.1)
        for kind in (KalmanFilter, ExtendedKalmanFilter)
        for model in (plain, attempt(plain).result)
    ]
    assert abs(plain.sampled(0.1).F @ before.mean + plain.sampled(0.1).G @ u)[0] > np.pi
    for other in beliefs:
        assert -np.pi <= other.mean[0] < np.pi
        assert_same(other, beliefs[0])


class Offset(Sensor):
    """A sensor of a sum of states with a bias, which the user calls linear."""

    linear = True
    output = Space(('sum',))
    covariance = np.array([[0.5]])

    def measure(self, x):
        return x[..., :1] + 2.0 * x[..., 1:2] + 7.0

    def jacobian(self, x):
        return np.array([[1.0, 2.0, 0.0]])


def sensors_of(state):
    return {
        'states': States(state, (0.3, 0.2), ('x2', 'x0')),
        'sums': Linear(state, (0.1, 0.4), (0.3, -1.0, 2.0, 1.0, 0.5, 0.25)),
        'offset': Offset(),
    }


def test_readings_correct_a_belief_as_in_numpy():
    plain = system(3, 1, seed=5, angles=('x0',))
    sensors = sensors_of(plain.state)
    fast = parts(plain, sensors)
    assert fast.arithmetic == 'C'
    rng = np.random.default_rng(2)
    for name, sensor in sensors.items():
        for seed in range(5):
            before, y = belief_of(3, seed), 4.0 * rng.standard_normal(len(sensor.covariance))
            mine = KalmanFilter(fast.model).correct(before, y, fast.sensors[name])
            theirs = KalmanFilter(plain).correct(before, y, sensor)
            assert_same(mine.posterior, theirs.posterior)
            for attribute in ('innovation', 'innovation_covariance', 'gain', 'jacobian', 'nis'):
                assert_same([getattr(mine, attribute)], [getattr(theirs, attribute)])


def test_a_covariance_of_a_message_replaces_that_of_a_sensor():
    plain = system(3, 1, seed=5)
    sensors = sensors_of(plain.state)
    fast, R = parts(plain, sensors), np.array([[2.0, 0.1], [0.1, 1.0]])
    before, y = belief_of(3, 0), np.array([1.0, 2.0])
    mine, theirs = (
        KalmanFilter(model).correct(before, y, sensor.with_covariance(R))
        for model, sensor in ((fast.model, fast.sensors['sums']), (plain, sensors['sums']))
    )
    assert_same(mine.posterior, theirs.posterior)


def test_many_readings_at_once_are_those_one_by_one_to_the_bit():
    """Also those of sums, which are in the same C in both ways."""
    plain = system(3, 1, seed=7)
    fast = parts(plain, sensors_of(plain.state))
    names, rng = list(fast.sensors), np.random.default_rng(4)
    arrivals = []
    for k in range(200):
        name = names[k % 3]
        y = rng.standard_normal(len(fast.sensors[name].covariance))
        y[0] += 7.0 * (name == 'offset')
        arrivals.append(Arrival(name, 10_000_000 * k + 1_000 * (k % 7), y))
    together, alone = (
        OnlineEstimator(KalmanFilter(fast.model), fast.sensors, belief_of(3, 1), np.zeros(1))
        for _ in range(2)
    )
    assert together.takes_many
    alone.add(arrivals[:1])
    for arrival in arrivals[1:]:
        alone.add([arrival])
    together.add(arrivals[:1])
    columns = columns_of(arrivals[1:], fast.sensors)
    taken = together.add_first(columns)
    assert len(taken.time) == 199
    for mine, theirs in zip(together.belief, alone.belief):
        np.testing.assert_array_equal(mine, theirs)


def columns_of(readings, sensors):
    """Return arrivals as columns, each received at its stamp."""
    names, m = list(sensors), 1
    time = np.array([reading.time for reading in readings])
    source = np.array([names.index(reading.source) for reading in readings])
    values, row = [], np.zeros(len(time), dtype=int)
    for index in range(len(names)):
        at = np.flatnonzero(source == index)
        row[at] = np.arange(len(at))
        values.append(np.array([readings[k].values for k in at]).reshape(len(at), -1))
    R = [
        np.broadcast_to(sensors[name].covariance, (len(y), *sensors[name].covariance.shape))
        for name, y in zip(names, values)
    ]
    return Arrivals(time, time, source, row, [*values, np.zeros((0, m))], R)


def test_a_system_that_grows_beyond_all_numbers_fails_as_in_numpy():
    plain = LinearSystem([[1e3]], np.zeros((1, 0)), [[1.0]], space(1), Space(()))
    fast = attempt(plain).result
    for model in (plain, fast):
        with pytest.raises(np.linalg.LinAlgError, match='grows beyond all numbers'):
            KalmanFilter(model).predict(Gaussian([1.0], [[1.0]]), np.zeros(0), 10.0)


@pytest.mark.parametrize(('gain', 'dt'), [(1e307, 10.0), (1e300, 30.0)])
def test_an_input_that_moves_it_beyond_all_numbers_fails_as_in_numpy(gain, dt):
    plain = LinearSystem([[1.0]], [[gain]], [[0.1]], space(1), Space(('u',)))
    for model in (plain, attempt(plain).result):
        with pytest.raises(np.linalg.LinAlgError, match='grows beyond all numbers'):
            KalmanFilter(model).predict(Gaussian([0.0], [[1.0]]), np.zeros(1), dt)


def test_what_has_another_shape_and_no_step_at_all_are_those_of_numpy():
    plain = system(3, 1, seed=5)
    fast, x, u = attempt(plain).result, np.ones(3), np.ones(1)
    for P in (np.eye(1), np.array(2.0), np.ones(9)):
        for model in (plain, fast):
            with pytest.raises(Exception, match=r'.'):
                model.predicted_moments(x, P, u, 0.1)
    for number in (0, -1):
        assert_same(fast.predicted_moments(x, np.eye(3), u, 0.1, number), (x, np.eye(3)))


class Sampled(LinearSystem):
    """A system whose steps are the user's."""

    def sampled(self, dt):
        step = super().sampled(dt)
        return step._replace(Q=2.0 * step.Q)


class Stepped(LinearSystem):
    """A system whose steps of a state are the user's."""

    def step(self, x, u, dt):
        return 2.0 * super().step(x, u, dt)


def test_what_c_does_not_know_stays_in_numpy():
    plain = system(2, 1, seed=1)
    given = plain.A, plain.B, plain.W, plain.state, plain.input
    large = system(MOST_STATES + 1, 0, seed=1)
    for model in (Sampled(*given), Stepped(*given), large):
        assert attempt(model).result is model
    assert attempt(plain, one_of_many=True).result is plain


class Wrong(Offset):
    """A sensor whose matrix has a column too many."""

    def jacobian(self, x):
        return np.ones((1, 4))


def test_a_sensor_with_a_wrong_matrix_is_refused_where_it_is_used():
    plain, sensor = system(3, 1, seed=5), Wrong()
    outcome = attempt(sensor, plain.state)
    assert outcome.result is sensor
    with pytest.raises(ValueError, match=r'.'):
        KalmanFilter(attempt(plain).result).correct(belief_of(3, 0), np.zeros(1), sensor)


def test_without_a_compiler_numpy_computes_and_nothing_is_said(monkeypatch):
    monkeypatch.setattr(library, 'compiler', lambda: ())
    plain = system(3, 1, seed=5)
    outcome = attempt(plain)
    assert outcome.result is plain
    assert (outcome.arithmetic, outcome.reason, outcome.pending) == ('numpy', '', '')


def test_what_is_yet_to_be_compiled_is_left_to_numpy(monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(library, '_known', {})
    plain = system(2, 2, seed=5)
    outcome = attempt(plain, wait=False)
    assert outcome.result is plain
    assert 'MANY_HALVINGS' in outcome.pending
    assert parts(plain, {}, wait=False).pending == [outcome.pending]
    assert parts(plain, {}, wait=False).arithmetic == 'numpy'


def test_another_process_has_the_same_system():
    plain = system(3, 1, seed=5)
    fast, sensor = attempt(plain).result, attempt(Offset(), plain.state).result
    again, other = pickle.loads(pickle.dumps((fast, sensor)))
    assert isinstance(again, NativeLinearSystem)
    before, y = belief_of(3, 0), np.array([1.0])
    mine = KalmanFilter(again).correct(before, y, other)
    assert_same(mine.posterior, KalmanFilter(fast).correct(before, y, sensor).posterior, 0.0)


def test_the_default_scenario_is_computed_in_c():
    built = scenario.build({'model': 'mass_spring_damper_2d'})
    assert parts(built.model, {k: s.sensor for k, s in built.sensors.items()}).arithmetic == 'C'
