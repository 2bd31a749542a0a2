# SPDX-License-Identifier: Apache-2.0
"""``kr.filter``: the online engine on arrays, in the shapes that people have."""

import inspect
import sys
import typing

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.models import find_model
from kalman_ros.sensors import build as build_sensor

CHAIN = kr.continuous_model([[0, 1], [0, 0]], [0, 1], [0, 0.1], states=['x', 'v'])
GPS = kr.sensor([1, 0], 0.25, 'gps')
PRIOR = kr.Gaussian([0, 0], np.eye(2))


def record(N=40, seed=0):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(1, 30, N) * 10**7) * 1e-9
    return rng, times, rng.normal(size=N), rng.normal(size=(N, 1))


@pytest.mark.parametrize('kind', ['kf', 'ekf', 'ukf', 'gaussian_sum'])
def test_it_is_the_online_estimator(kind):
    """Whatever the order in which readings and inputs arrive, to the last bit."""
    rng, times, y, u = record()
    found = kr.filter(CHAIN, GPS, times, y, u, PRIOR, filter=kind)
    online = OnlineEstimator(
        build_filter(kind, Plan(CHAIN, {}, 1.0)), {'gps': GPS}, PRIOR, np.zeros(1), Policy(100.0)
    )
    stamps = np.rint(times * 1e9).astype(int)
    for k in np.argsort(np.arange(40) + rng.uniform(0, 6, 40)):  # late by up to six
        online.add_input(int(stamps[k]), u[k])
        online.add_reading('gps', int(stamps[k]), y[k : k + 1])
    np.testing.assert_array_equal(found.mean[-1], online.belief.mean)
    np.testing.assert_array_equal(found.covariance[-1], online.belief.covariance)
    assert found.filter == kind


def test_filterpy_agrees():
    filterpy = pytest.importorskip('filterpy.kalman')
    _, _, y, u = record()
    F, G, Q, _ = kr.discretize(CHAIN, 0.1)
    peer = filterpy.KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    peer.F, peer.B, peer.Q, peer.H, peer.R = F, G, Q, np.array([[1.0, 0.0]]), np.array([[0.25]])
    expected, peer.x = [], np.zeros(2)
    for k, z in enumerate(y):
        if k:
            peer.predict(u=u[k - 1])
        peer.update(z)
        expected.append(peer.x.ravel())
    for model, times in ((CHAIN, np.arange(40) * 0.1), (kr.discrete_model(F, G, Q), None)):
        found = kr.filter(model, ([1, 0], 0.25), times, y, u, ([0, 0], 1))
        np.testing.assert_allclose(found.mean, expected, rtol=1e-9, atol=1e-12)


def test_shapes_that_people_have():
    _, times, y, u = record()
    expected = kr.filter(CHAIN, GPS, times, y, u, PRIOR)
    for sensors in ([GPS], {'gps': GPS}, {'gps': ([1, 0], 0.25)}, ([[1, 0]], [[0.25]])):
        for readings in (y.tolist(), y[:, np.newaxis], y[:, np.newaxis, np.newaxis]):
            found = kr.filter(CHAIN, sensors, times.tolist(), readings, u[:, 0].tolist(), PRIOR)
            np.testing.assert_array_equal(found.mean, expected.mean)
    for initial in (([0, 0], [1, 1]), (np.zeros((2, 1)), 1.0), ([0, 0], np.eye(2))):
        found = kr.filter(CHAIN, GPS, times, y, u, initial)
        np.testing.assert_array_equal(found.mean, expected.mean)
    assert expected.mean.shape == (40, 2)
    assert expected.covariance.shape == (40, 2, 2)
    assert expected.nis.shape == expected.time.shape == (40,)
    assert len(expected) == 40
    np.testing.assert_array_equal(expected.time, times)


def test_several_sensors_side_by_side_or_with_times_of_their_own():
    rng, times, y, _ = record()
    speed = kr.sensor([0, 1], 0.1, 'speed')
    both = np.column_stack([y, rng.normal(size=40)])
    both[::3, 1] = np.nan
    one = kr.filter(CHAIN, [GPS, speed], times, both, None, PRIOR)
    there = np.isfinite(both[:, 1])
    two = kr.filter(
        CHAIN, [GPS, speed], {'gps': times, 'speed': times[there]},
        {'gps': y, 'speed': both[there, 1]}, None, PRIOR,
    )  # fmt: skip
    np.testing.assert_array_equal(one.mean, two.mean)
    assert one.counts == {'gps': {'fused': 40}, 'speed': {'fused': int(there.sum())}}
    np.testing.assert_array_equal(one.degrees, 1 + there)
    assert len(one.innovations['speed'].nis) == there.sum()
    np.testing.assert_allclose(
        np.nansum(one.nis), sum(each.nis.sum() for each in one.innovations.values())
    )


def test_a_row_that_is_missing_or_missing_in_part():
    pair = kr.sensor(np.eye(2), [0.25, 0.5], 'pair')
    y = np.array([[1.0, 2.0], [np.nan, np.nan], [np.nan, 1.0], [3.0, np.nan]])
    found = kr.filter(CHAIN, pair, np.arange(4.0), y, None, PRIOR)
    assert found.counts == {'pair': {'fused': 3}}
    assert np.isnan(found.nis[1])
    np.testing.assert_array_equal(found.degrees, [2, 0, 1, 1])
    assert found.std[1, 0] > found.std[0, 0]
    parts = {'a': kr.sensor([1, 0], 0.25), 'b': kr.sensor([0, 1], 0.5)}
    split = kr.filter(CHAIN, parts, np.arange(4.0), {'a': y[:, 0], 'b': y[:, 1]}, None, PRIOR)
    np.testing.assert_allclose(found.mean, split.mean, rtol=1e-12)
    np.testing.assert_allclose(found.log_likelihood, split.log_likelihood)


def test_a_rotation_that_is_missing_in_part_is_missing():
    built = kr.load('robot_3d')
    turn = {'measures': ['rx', 'ry', 'rz']}
    attitude = build_sensor('states', built.model.state, [0.1] * 3, turn)
    y = np.array([[0.1, 0.2, 0.3], [np.nan, 0.2, 0.3]])
    found = kr.filter(built.model, attitude, [0.0, 0.1], y, None, built.initial_belief)
    assert list(found.counts.values()) == [{'fused': 1}]


def test_a_first_row_that_is_missing_does_not_move_the_start():
    found = kr.filter(CHAIN, GPS, [0.0, 1.0], [np.nan, 1.0], None, ([0, 1], 1e-6))
    np.testing.assert_array_equal(found.mean[0], [0, 1])
    np.testing.assert_allclose(found.mean[1], [1, 1], atol=1e-6)


def test_inputs_one_for_all_or_with_times_of_their_own():
    rows = kr.filter(CHAIN, GPS, [0, 1, 2], [0, 0, 0], [2, 2, 2], PRIOR)
    for inputs in (2.0, [2.0], np.float32(2)):
        one = kr.filter(CHAIN, GPS, [0, 1, 2], [0, 0, 0], inputs, PRIOR)
        np.testing.assert_array_equal(one.mean, rows.mean)
    late = kr.filter(CHAIN, GPS, [0, 1, 2], [0, 0, 0], [2, 0], PRIOR, input_times=[0.5, 1.5])
    assert late.mean[0, 1] == 0.0
    assert len(late) == 3
    np.testing.assert_allclose(
        late.mean[1], kr.filter(CHAIN, GPS, [0, 0.5, 1], [0, np.nan, 0], [0, 2, 0], PRIOR).mean[2]
    )


def test_a_gate_rejects_and_counts():
    _, times, y, u = record()
    y = 0.3 * y
    y[20] = 1e3
    found = kr.filter(CHAIN, GPS, times, y, u, PRIOR, gates={'gps': 0.999})
    assert found.counts['gps']['rejected: outside the gate'] == 1
    assert np.abs(found.mean[:, 0]).max() < 10.0
    assert 'rejected: outside the gate' in repr(found)


def test_long_silence_is_no_restart():
    found = kr.filter(CHAIN, GPS, [0, 1, 1e5], [0, np.nan, np.nan], None, PRIOR)
    assert found.std[2, 0] > 1e5


def test_a_scenario_has_sensors_and_a_first_belief():
    found = kr.filter('cart_pole', None, [0, 0.01], [[0, 0.3], [0, 0.3]])
    assert found.filter == 'ekf'
    assert found.mean.shape == (2, 4)


@pytest.mark.slow
def test_functions_that_take_one_state_at_a_time():
    def one(x, u):
        return np.array([x[1], u[0] - np.sin(x[0])])

    def many(x, u):
        return np.stack((x[..., 1], u[..., 0] - np.sin(x[..., 0])), axis=-1)

    _, times, y, u = record()
    names = {'states': ['theta [rad]', 'omega [rad/s]'], 'inputs': ['tau'], 'angles': ['theta']}
    for kind in ('ekf', 'ukf'):
        each = [
            kr.filter(kr.continuous_model(f, 0.1, **names), kr.sensor(h, 0.1), times, y, u,
                      ([0, 0], 1), filter=kind)
            for f, h in ((one, lambda x: np.sin(x[0])), (many, lambda x: np.sin(x[..., :1])))
        ]  # fmt: skip
        np.testing.assert_allclose(each[0].mean, each[1].mean, rtol=1e-12)
    sampled = kr.discrete_model(lambda x: [x[0] + 0.1 * x[1], 0.9 * x[1]], [0, 0.1])
    assert kr.filter(sampled, GPS, None, y, None, PRIOR).mean.shape == (40, 2)


def test_it_prints_and_goes_on():
    _, times, y, u = record()
    first = kr.filter(CHAIN, GPS, times[:20], y[:20], u[:20], PRIOR)
    lines = str(first).splitlines()
    assert lines[0] == f'2 states at 20 times from {times[0]:g} to {times[19]:g} s, filtered by kf'
    assert lines[4] == 'readings of gps: 20 fused'
    assert all(len(line) < 80 for line in lines)
    y = np.append(np.nan, y[20:])
    more = kr.filter(CHAIN, GPS, times[19:], y, u[19:], first.last)
    whole = kr.filter(CHAIN, GPS, *record()[1:], PRIOR)
    np.testing.assert_allclose(more.last.mean, whole.last.mean, rtol=1e-12)


@pytest.mark.slow
def test_pictures(tmp_path):
    _, times, y, u = record()
    found = kr.filter(CHAIN, kr.sensor([1, 0], 0.25, 'gps', outputs=['x']), times, y, u, PRIOR)
    for each in (found, kr.smooth(found)):
        axes = each.plot(tmp_path / 'states.png', truth=np.zeros((40, 2)))
        assert axes.shape == (2, 1)
        assert (tmp_path / 'states.png').stat().st_size > 10_000
        labels = {line.get_label() for line in axes[0, 0].lines}
        assert labels == {'reading', 'truth', 'smoothed' if each.smoothed else 'filtered'}


@pytest.mark.slow
def test_consistency():
    rng = np.random.default_rng(0)
    estimates, truths = [], []
    for _ in range(10):
        x, truth, y = rng.multivariate_normal(PRIOR.mean, PRIOR.covariance), [], []
        F, _, Q, _ = kr.discretize(CHAIN, 0.1)
        for _ in range(100):
            truth.append(x)
            y.append(x[0] + 0.5 * rng.normal())
            x = F @ x + rng.multivariate_normal([0, 0], Q)
        estimates.append((np.arange(100) * 0.1, y))
        truths.append(np.array(truth))

    def judged(R):
        found = [kr.filter(CHAIN, ([1, 0], R), *each, None, PRIOR) for each in estimates]
        return kr.consistency(found, truths), kr.consistency([kr.smooth(f) for f in found], truths)

    right, smoothed = judged(0.25)
    assert right and right.passed and smoothed, (right, smoothed)
    assert str(right).startswith('PASS: 2 of 2 checks passed')
    assert str(smoothed).startswith('PASS: 1 of 1 checks passed')
    for R, hint in ((0.1, 'larger than'), (1.0, 'smaller than')):
        report, late = judged(R)
        assert not report, late
        assert str(report).startswith('FAIL: ') and hint in str(report)


@pytest.mark.parametrize('filter', ['kf', 'ekf', 'ukf'])
@pytest.mark.parametrize('known', [[0, 0], [1, 0], [0, 1]])
def test_a_start_that_is_known_exactly_is_the_limit_of_small_variances(filter, known):
    model = kr.continuous_model([[0, 1], [-1, 0]], W=[0, 0.1])
    task = model, kr.sensor([1, 0], 0.01), np.arange(20) * 0.1, np.sin(np.arange(20.0))

    def estimates(variances):
        found = kr.filter(*task, initial=([0, 1], variances), filter=filter)
        return found, kr.smooth(found)

    near = [variance or 1e-10 for variance in known]
    for exact, limit in zip(estimates(known), estimates(near)):
        np.testing.assert_allclose(exact.mean, limit.mean, atol=1e-7)
        np.testing.assert_allclose(exact.covariance, limit.covariance, atol=1e-7)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'initial': None}, 'initial: expected a Gaussian or a pair of mean and covariance'),
        ({'initial': ([0], 1)}, 'initial mean: expected 2 numbers, got 1'),
        ({'initial': ([0, 0], [1, -1])}, 'initial covariance: expected a positive semi-definite'),
        ({'readings': np.zeros((3, 2))}, r'readings: expected shape \(N, 1\), got \(3, 2\)'),
        ({'readings': [1, 2]}, 'readings: expected 3 rows, one a time, got 2'),
        ({'readings': ['a', 'b', 'c']}, r'readings: expected numbers \(N, 1\)'),
        ({'readings': []}, 'readings: expected'),
        ({'readings': {'gsp': [1, 2, 3]}}, "readings: 'gsp' is not one of the sensors"),
        ({'times': None}, 'times: expected'),
        ({'times': [0, np.nan, 1]}, 'times: expected finite times'),
        ({'inputs': [[1, 2], [1, 2], [1, 2]]}, r'inputs: expected shape \(N, 1\)'),
        ({'inputs': [1, np.nan, 2]}, 'inputs: expected finite numbers'),
        ({'inputs': 'push'}, 'inputs: expected real numbers'),
        ({'inputs': {}}, 'inputs: expected real numbers'),
        ({'initial': ('a', 1.0)}, 'initial mean: expected real numbers'),
        ({'sensors': None}, 'sensors: expected a sensor, several by name'),
        ({'sensors': 3}, r'sensors: expected a sensor, a pair \(H, R\)'),
        ({'sensors': ([1, 0, 0], 1.0)}, 'y: expected 2 columns of H, one a state, got 3'),
        ({'sensors': ([1, 0], -1.0)}, 'R: expected a positive definite'),
        ({'sensors': [GPS, GPS]}, 'sensors: expected distinct names, got'),
        ({'model': [[1]]}, 'model: expected a model or a scenario, got ..1.'),
        ({'model': 'cartpole'}, "scenario: unknown scenario 'cartpole'; did you mean 'cart_pole'"),
        ({'filter': 'efk'}, "unknown filter 'efk'; did you mean 'ekf'"),
        ({'gates': 99.9}, 'gates: expected a probability such as 0.999, got 99.9'),
    ],
)
def test_mistakes_are_named(change, says):
    given = {'model': CHAIN, 'sensors': GPS, 'times': [0, 1, 2], 'readings': [1, 2, 3]}
    given |= {'initial': PRIOR, **change}
    with pytest.raises(ValueError, match=f'^{says}'):
        kr.filter(**given)


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: kr.Gaussian(np.zeros(2), np.eye(3)),
         'covariance: expected 2 x 2 for a mean of 2 numbers, got 3 x 3'),
        (lambda: kr.Gaussian(0.0, 1.0), 'mean: expected a vector, got the number 0.0'),
        (lambda: KalmanFilter(find_model('cart_pole')()),
         'filter: kf needs a linear model, got CartPole'),
        (lambda: kr.sensor([1, 0], 1.0, ''), "name: expected a word, such as 'gps', got ''"),
        (lambda: kr.sensor({}, 1.0), 'H: expected real numbers, in rows of one length, got dict'),
        (lambda: kr.consistency(None), 'estimates: expected those of one run, or a list .*noth'),
        (lambda: kr.consistency([]), 'estimates: expected at least one run, got none'),
        (lambda: kr.continuous_model(lambda x: x, 1.0), 'states: expected names or a number'),
        (lambda: kr.continuous_model(lambda x: x['a'], [1.0]), 'A: its derivative fails'),
        (lambda: kr.continuous_model(lambda x: x[:1], [1, 1]),
         'A: its derivative: expected 2 numbers'),
        (lambda: kr.discrete_model([[1, 0]], Q=1.0), 'F: expected a square matrix'),
        (lambda: kr.continuous_model([[1]], W=1.0, states=['a', 'b']), 'states: expected 1 names'),
    ],
)  # fmt: skip
def test_mistakes_in_what_is_built(call, says):
    with pytest.raises(ValueError, match=f'^{says}'):
        call()


def test_an_unnamed_sensor():
    """One is called y; an observer with gains by name says which it has."""
    bare = kr.sensor([1, 0], 0.25)
    bare.name = ''
    assert kr.filter(CHAIN, bare, [0, 1], [1, 2], None, PRIOR).counts == {'y': {'fused': 2}}
    observer = kr.filter(CHAIN, GPS, [0, 1], [1, 2], None, PRIOR, filter='steady_state')
    with pytest.raises(ValueError, match=r'sensor: expected a name among \(gps\).*sensor.name'):
        observer.record.filter.correct(PRIOR, np.zeros(1), bare)


def test_everything_prints_its_contents():
    assert repr(GPS) == "MatrixSensor 'gps'(reads: gps; covariance: [[0.25]])"
    assert repr(find_model('cart_pole')()) == (
        'CartPole(state: x [m], v [m/s], theta [rad], omega [rad/s]; input: f [N])'
    )
    assert repr(kr.continuous_model([[-1]], W=2)) == (
        'LinearSystem(state: x0; input: none; A: [[-1.0]]; B: [[]]; W: [[2.0]])'
    )
    assert 'F: [[1.0]]; G: [[]]; Q: [[2.0]]; period: 1 s' in repr(kr.discrete_model([[1]], Q=2))
    for value in (PRIOR, kr.load('cart_pole'), CHAIN.state, kr.Space(('a',), ('m',))):
        assert ' at 0x' not in repr(value)


def test_readings_are_drawn_where_a_state_is_read_alone():
    """Whatever the sensor calls them, and in the unit of the state."""
    plt = pytest.importorskip('matplotlib.pyplot')
    model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0.1], states='place speed')
    times, y = np.arange(5.0), np.arange(5.0)[:, np.newaxis] * [1.0, 2.0]
    found = kr.filter(model, ([[1, 1], [0, 4]], [1, 1]), times, y, initial=([0, 1], 0.1))
    axes = found.plot()[:, 0]
    dots = [
        [line.get_ydata().tolist() for line in axis.lines if line.get_label() == 'reading']
        for axis in axes
    ]
    plt.close('all')
    # the first row reads a sum, the second four times the speed
    assert dots == [[], [(0.5 * times).tolist()]]


@pytest.mark.skipif(sys.version_info < (3, 11), reason='typing.get_overloads')
def test_the_first_belief_of_a_model_has_no_default_in_the_signature():
    of_scenario, of_model = map(inspect.signature, typing.get_overloads(kr.filter))
    assert of_scenario.parameters['initial'].default is None
    assert of_model.parameters['initial'].default is inspect.Parameter.empty
    whole = inspect.signature(kr.filter).parameters
    assert [*of_model.parameters] == [*whole]
    assert {*of_scenario.parameters} == {*whole} - {'sensors'}
