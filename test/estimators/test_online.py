# SPDX-License-Identifier: Apache-2.0
"""Order, late data and the account of every reading."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalman_ros import scenario
from kalman_ros.core import Gaussian, LinearSystem, Model, Space, TimedSensor
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.sensors.bearing import Bearing
from kalman_ros.sensors.radar import Radar

SECOND = 1_000_000_000


def estimator(window=10.0, gates=None, filter='kf', **options):
    plan = scenario.build({'model': 'mass_spring_damper'}).plan
    return OnlineEstimator(
        build_filter(filter, plan),
        {name: timed.sensor for name, timed in plan.sensors.items()},
        Gaussian(np.zeros(2), np.eye(2)),
        np.zeros(1),
        Policy(window=window, gates=gates, **options),
    )


def feed(online, item):
    kind, time, value = item
    if kind == 'input':
        return online.add_input(time, np.array([value]))
    return online.add_reading(kind, time, np.array([value]))[0]


items = st.lists(
    st.tuples(
        st.sampled_from(['position', 'velocity', 'input']),
        st.integers(0, 50).map(lambda k: SECOND + 20_000_000 * k),
        st.floats(-2.0, 2.0),
    ),
    min_size=1,
    max_size=30,
    unique_by=lambda item: item[:2],
)


@pytest.mark.slow
@given(items, st.randoms(use_true_random=False), st.booleans())
def test_the_order_of_arrival_does_not_matter(given_items, random, gated):
    gates = {'position': 3.0} if gated else None
    in_order, shuffled = estimator(gates=gates), estimator(gates=gates)
    for item in sorted(given_items, key=lambda item: item[1]):
        feed(in_order, item)
    mixed = list(given_items)
    random.shuffle(mixed)
    for item in mixed:
        feed(shuffled, item)
    assert shuffled.time == in_order.time
    assert shuffled.counts == in_order.counts
    np.testing.assert_array_equal(shuffled.belief.mean, in_order.belief.mean)
    np.testing.assert_array_equal(shuffled.belief.covariance, in_order.belief.covariance)


def test_the_input_in_effect_is_the_one_used():
    online = estimator()
    online.add_reading('position', SECOND, np.array([0.0]))
    online.add_input(SECOND, np.array([1.0]))
    online.add_input(SECOND + SECOND // 2, np.array([-1.0]))
    start, filter = online.belief, online._filter
    found = online.predicted(2 * SECOND)
    online = estimator()
    online.add_reading('position', SECOND, np.array([0.0]))
    start = online.belief
    half = filter.predict(start, np.array([1.0]), 0.5)
    expected = filter.predict(half, np.array([-1.0]), 0.5)
    np.testing.assert_allclose(found.mean, expected.mean, atol=1e-15)


def test_of_two_inputs_with_one_stamp_the_last_counts():
    once, twice = estimator(), estimator()
    for online, inputs in ((once, [2.0]), (twice, [1.0, 2.0])):
        online.add_reading('position', SECOND, np.array([0.3]))
        for value in inputs:
            assert online.add_input(SECOND, np.array([value])) is Outcome.FUSED
        assert online.add_input(SECOND, np.array([2.0])) is Outcome.DUPLICATE
        online.add_reading('velocity', 2 * SECOND, np.array([0.1]))
    np.testing.assert_array_equal(twice.belief.mean, once.belief.mean)
    # late too: what followed is done again
    once.add_input(SECOND, np.array([-1.0]))
    assert not np.array_equal(twice.belief.mean, once.belief.mean)


def test_prediction_keeps_nothing():
    online = estimator()
    online.add_reading('position', SECOND, np.array([0.5]))
    before = online.belief
    online.predicted(5 * SECOND)
    assert online.belief is before
    assert online.time == SECOND


def test_what_is_older_than_the_window_is_dropped_and_counted():
    online = estimator(window=0.5)
    for k in range(100):
        online.add_reading('position', SECOND + k * 20_000_000, np.array([0.0]))
    before = online.belief
    outcome, correction = online.add_reading('velocity', SECOND, np.array([1.0]))
    assert outcome is Outcome.TOO_OLD
    assert correction is None
    assert online.belief is before
    assert online.counts['velocity'][Outcome.TOO_OLD] == 1
    late = SECOND + 99 * 20_000_000 - 400_000_000 + 1
    assert online.add_reading('velocity', late, np.array([1.0]))[0] is Outcome.FUSED


@pytest.mark.parametrize('count', range(60, 77))
def test_at_the_far_end_of_the_window_late_is_as_good_as_in_order(count):
    """Also just before the oldest reading that is kept, whenever the last were forgotten."""
    step, window = 20_000_000, 510_000_000
    readings = [('position', SECOND + k * step, 0.1 * k) for k in range(count)]
    extra = ('velocity', readings[-1][1] - window, 1.0)
    late, in_order = estimator(window=window * 1e-9), estimator(window=window * 1e-9)
    for item in readings:
        feed(late, item)
    assert feed(late, extra) is Outcome.FUSED
    for item in sorted([*readings, extra], key=lambda item: item[1]):
        feed(in_order, item)
    np.testing.assert_array_equal(late.belief.mean, in_order.belief.mean)
    np.testing.assert_array_equal(late.belief.covariance, in_order.belief.covariance)


def test_no_more_is_kept_than_the_window_asks_for():
    for window, most in ((0.5, 27 + 16), (0.0, 1)):
        online = estimator(window=window)
        for k in range(200):
            feed(online, ('position', SECOND + k * 20_000_000, 0.0))
        assert len(online._timeline._items) <= most


@pytest.mark.parametrize('recover_after', [1, 2, 5])
def test_recovery_comes_with_the_reading_that_it_is_due_with(recover_after):
    online = estimator(gates={'position': 9.0}, recover_after=recover_after)
    outcomes = [feed(online, ('position', k * SECOND // 100, 1e3)) for k in range(recover_after)]
    assert outcomes == [Outcome.REJECTED] * (recover_after - 1) + [Outcome.RECOVERED]


def test_only_rejections_in_a_row_count():
    online = estimator(gates={'position': 9.0}, recover_after=3)
    for k in range(20):
        outcome = feed(online, ('position', k * SECOND // 1000, 0.0 if k % 3 == 2 else 1e3))
        assert outcome is (Outcome.FUSED if k % 3 == 2 else Outcome.REJECTED)


def test_the_noise_of_one_reading_is_not_that_of_the_next():
    online, alone = estimator(), estimator()
    y = np.array([1.0])
    online.add_reading('position', SECOND, y, np.array([[4.0]]))
    alone.add_reading('position', SECOND, y, np.array([[4.0]]))
    _, correction = online.add_reading('position', 2 * SECOND, y, np.array([[0.25]]))
    prior = alone.predicted(2 * SECOND).covariance[0, 0]
    np.testing.assert_allclose(correction.innovation_covariance, [[prior + 0.25]], rtol=1e-12)


@pytest.mark.parametrize(
    ('y', 'covariance', 'outcome'),
    [
        ([np.nan], None, Outcome.NOT_FINITE),
        ([np.inf], None, Outcome.NOT_FINITE),
        ([1.0, 2.0], None, Outcome.WRONG_SIZE),
        ([], None, Outcome.WRONG_SIZE),
        ([1.0], [[0.0]], Outcome.BAD_COVARIANCE),
        ([1.0], [[-1.0]], Outcome.BAD_COVARIANCE),
        ([1.0], [[np.nan]], Outcome.BAD_COVARIANCE),
        ([1.0], [[1.0, 0.0], [0.0, 1.0]], Outcome.BAD_COVARIANCE),
    ],
)
def test_bad_readings_change_nothing_and_are_counted(y, covariance, outcome):
    online = estimator()
    online.add_reading('position', SECOND, np.array([0.5]))
    before = online.belief
    R = None if covariance is None else np.array(covariance)
    assert online.add_reading('position', 2 * SECOND, np.array(y), R)[0] is outcome
    assert online.belief is before
    assert online.counts['position'] == {Outcome.FUSED: 1, outcome: 1}


def test_the_same_stamp_twice_is_a_duplicate():
    online = estimator()
    feed(online, ('position', SECOND, 0.5))
    before = online.belief
    assert feed(online, ('position', SECOND, 0.9)) is Outcome.DUPLICATE
    np.testing.assert_array_equal(online.belief.mean, before.mean)


def test_a_gate_keeps_the_outlier_out():
    online = estimator(gates={'position': 10.0})
    for k in range(20):
        feed(online, ('position', SECOND + k * 20_000_000, 0.0))
    before = online.belief
    outcome, correction = online.add_reading('position', 2 * SECOND, np.array([50.0]))
    assert outcome is Outcome.REJECTED
    assert correction.nis > 10.0
    assert abs(online.belief.mean[0]) < 0.2
    assert np.trace(online.belief.covariance) > np.trace(before.covariance)


def test_a_covariance_of_its_own_is_used():
    sharp, blunt = estimator(), estimator()
    sharp.add_reading('position', SECOND, np.array([1.0]), np.array([[1e-6]]))
    blunt.add_reading('position', SECOND, np.array([1.0]), np.array([[1e6]]))
    assert sharp.belief.mean[0] > 0.99
    assert blunt.belief.mean[0] < 0.01


def test_reset_forgets_but_goes_on_counting():
    online = estimator()
    feed(online, ('position', SECOND, 0.5))
    online.reset(Gaussian(np.zeros(2), np.eye(2)))
    assert online.time is None
    assert feed(online, ('position', SECOND // 2, 0.1)) is Outcome.FUSED
    assert online.counts['position'][Outcome.FUSED] == 2


def test_a_microsecond_moves_the_estimate_by_less_than_a_thousandth_sigma():
    shifted, exact = estimator(), estimator()
    for k in range(50):
        time = SECOND + k * 20_000_000
        feed(exact, ('position', time, 0.3))
        feed(shifted, ('position', time + (1000 if k == 30 else 0), 0.3))
    difference = np.abs(shifted.belief.mean - exact.belief.mean)
    assert np.all(difference < 1e-3 * exact.belief.std)


@pytest.mark.parametrize('filter', ['ekf', 'ukf', 'steady_state', 'luenberger'])
def test_late_readings_are_fused_again_by_every_filter(filter):
    rng = np.random.default_rng(0)
    given_items = [
        (kind, SECOND + 20_000_000 * k, rng.normal())
        for k in range(40)
        for kind in ('position', 'velocity', 'input')
    ]
    in_order, shuffled = estimator(filter=filter), estimator(filter=filter)
    for item in given_items:
        feed(in_order, item)
    for index in rng.permutation(len(given_items)):
        feed(shuffled, given_items[index])
    np.testing.assert_allclose(shuffled.belief.mean, in_order.belief.mean, atol=1e-9)
    np.testing.assert_allclose(shuffled.belief.covariance, in_order.belief.covariance, atol=1e-9)


def wrong_and_sure(**options):
    """An estimator that is sure of being elsewhere, behind a gate."""
    online = estimator(gates={'position': 9.0}, **options)
    online.reset(Gaussian(np.array([50.0, 0.0]), 1e-6 * np.eye(2)))
    return online


def test_a_filter_that_is_wrong_and_sure_is_locked_out_without_recovery():
    online = wrong_and_sure(recover_after=0)
    for k in range(60):
        assert feed(online, ('position', SECOND + k * 20_000_000, 0.0)) is Outcome.REJECTED


def test_a_filter_that_is_wrong_and_sure_recovers():
    online = wrong_and_sure(recover_after=10)
    outcomes = [feed(online, ('position', SECOND + k * 20_000_000, 0.0)) for k in range(60)]
    assert outcomes[:9] == [Outcome.REJECTED] * 9
    assert outcomes[9] is Outcome.RECOVERED
    assert Outcome.REJECTED not in outcomes[12:]
    assert abs(online.belief.mean[0]) < 4.0 * online.belief.std[0]


def test_a_clock_that_goes_back_restarts_the_estimator_but_one_stray_stamp_does_not():
    online = estimator(window=0.5, restart_after=5)
    for k in range(100):
        feed(online, ('position', 100 * SECOND + k * 20_000_000, 0.0))
    assert feed(online, ('position', SECOND, 0.0)) is Outcome.TOO_OLD
    feed(online, ('position', 103 * SECOND, 0.0))
    outcomes = [feed(online, ('position', SECOND + k * 20_000_000, 3.0)) for k in range(8)]
    assert outcomes == [Outcome.TOO_OLD] * 4 + [Outcome.FUSED] * 4
    assert online.restarts == 1
    assert online.time == SECOND + 7 * 20_000_000


def test_a_sensor_that_lags_is_no_clock_that_goes_back():
    """A flood of old readings between up-to-date ones leaves the estimate alone."""
    online = estimator(window=0.5, restart_after=5)
    for k in range(100):
        now = 100 * SECOND + k * 10_000_000
        assert online.add_reading('position', now, np.zeros(1), None, now)[0] is Outcome.FUSED
        for j in range(50):
            old = now - 2 * SECOND + j
            outcome, _ = online.add_reading('velocity', old, np.ones(1), None, now + j)
            assert outcome is Outcome.TOO_OLD
    assert online.restarts == 0
    assert online.counts['velocity'] == {Outcome.TOO_OLD: 5000}


def test_old_readings_alone_are_a_clock_that_went_back():
    online = estimator(window=0.5, restart_after=5)
    now = 100 * SECOND
    online.add_reading('position', now, np.zeros(1), None, now)
    for k in range(100):
        now += 10_000_000
        online.add_reading('position', SECOND + k * 10_000_000, np.zeros(1), None, now)
    assert online.restarts == 1
    assert online.counts['position'][Outcome.TOO_OLD] == 24
    assert online.time == SECOND + 99 * 10_000_000


def test_after_a_long_gap_the_old_belief_is_worth_nothing():
    online = estimator(max_gap=60.0)
    for k in range(100):
        feed(online, ('position', SECOND + k * 20_000_000, 0.0))
    feed(online, ('velocity', 7200 * SECOND, 0.0))
    assert online.belief.std[0] == 1.0
    assert np.isfinite(online.belief.mean).all()


def test_a_belief_is_kept_for_the_longest_gap_and_no_longer():
    online = estimator(max_gap=60.0)
    initial = online.belief
    feed(online, ('position', SECOND, 1.0))
    feed(online, ('input', SECOND, 1.0))
    ending = 2 * SECOND, np.zeros(1)
    held, ended = online.predicted(61 * SECOND), online.predicted(61 * SECOND, ending)
    assert held is not initial
    assert abs(ended.mean[0]) < 0.5 * abs(held.mean[0])
    assert online.predicted(61 * SECOND + 1) is initial
    assert online.predicted(61 * SECOND + 1, ending) is initial
    feed(online, ('input', 61 * SECOND, 0.0))
    assert online.restarts == 0
    feed(online, ('input', 121 * SECOND + 1, 0.0))
    assert online.restarts == 1
    assert online.belief is initial


class Overflowing(KalmanFilter):
    """A filter that predicts nothing sound over more than a second."""

    def predict(self, belief, u, dt):
        prior = super().predict(belief, u, dt)
        return prior if dt <= 1.0 else prior._replace(mean=prior.mean * np.inf)


def test_a_prediction_that_is_not_sound_is_not_kept():
    online = estimator()
    online._filter = Overflowing(online._filter.model)
    initial = online.belief
    for k in range(5):
        feed(online, ('position', SECOND + k * 20_000_000, 1.0))
    assert online.predicted(4 * SECOND) is initial
    assert feed(online, ('input', 4 * SECOND, 1.0)) is Outcome.FUSED
    assert online.belief is initial
    assert online.restarts == 1
    # a reading is fused into the initial belief, for it is as good as any
    assert feed(online, ('position', 8 * SECOND, 1.0)) is Outcome.FUSED
    assert online.belief.std[0] < initial.std[0]
    assert online.restarts == 2


class Leap(Model):
    """A point that moves in the plane, and leaps out of it where a step is long."""

    state, input = Space(('x', 'y'), ('m', 'm')), Space((), ())

    def derivative(self, x, u):
        return np.zeros_like(x)

    def noise_density(self, x):
        return np.eye(2)

    def step(self, x, u, dt):
        return x * np.inf if dt > 1.5 else x


class Blink(Bearing):
    """Bearings that are now and then no numbers."""

    blinks = False

    def measure(self, x):
        return super().measure(x) * (np.nan if self.blinks else 1.0)


@pytest.mark.parametrize('gates', [None, {'bearing': 9.0}])
@pytest.mark.parametrize(
    ('filter', 'implementation'),
    [
        ('ekf', 'native'), ('ukf', 'native'), ('gaussian_sum', 'native'),
        ('ekf', 'filterpy'), ('ukf', 'filterpy'),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_models_and_sensors_that_break_lose_no_reading(filter, implementation, gates):
    if implementation == 'filterpy':
        pytest.importorskip('filterpy')
    model = Leap()
    sensor = Blink(model.state, [0.1], ('x', 'y'))
    sensor.name = 'bearing'
    plan = Plan(model, {'bearing': TimedSensor(sensor, 10.0)}, 10.0)
    built = build_filter(filter, plan, implementation=implementation)
    initial = Gaussian(np.ones(2), np.eye(2))
    online = OnlineEstimator(built, {'bearing': sensor}, initial, np.zeros(0), Policy(gates=gates))
    found = []
    for tenth, blinks in ((10, 0), (11, 0), (40, 0), (41, 0), (42, 1), (43, 0), (43.5, 1)):
        sensor.blinks = bool(blinks)
        reading = 'bearing', round(tenth * SECOND / 10), np.full(1, 0.7)
        outcome, correction = online.add_reading(*reading)
        found.append(outcome)
        assert np.isfinite(online.belief.mean).all()
        assert np.isfinite(online.predicted(online.time + SECOND // 10).covariance).all()
        if correction is not None:
            assert np.isfinite(correction.nis)
            assert np.isfinite(correction.innovation).all()
    good, bad = Outcome.FUSED, Outcome.INDEFINITE
    assert found == [good, good, good, good, bad, good, bad]
    assert online.restarts == 1


def test_what_came_before_a_change_is_done_again_as_it_was():
    """A filter of fixed gains has none for a sensor that was switched off since."""
    plan = scenario.build({'model': 'mass_spring_damper'}).plan
    alone = Plan(plan.model, {'position': plan.sensors['position']}, plan.rate)
    sensors = {name: timed.sensor for name, timed in plan.sensors.items()}
    online = estimator(filter='steady_state')
    feed(online, ('velocity', SECOND, 0.3))
    online.configure(build_filter('steady_state', alone), sensors, Policy(window=10.0))
    feed(online, ('position', SECOND + 60_000_000, 0.1))
    assert feed(online, ('position', SECOND - 20_000_000, 0.2)) is Outcome.FUSED
    assert online.counts['velocity'] == {Outcome.FUSED: 1}
    assert np.isfinite(online.belief.mean).all()


def test_a_window_that_becomes_wider_does_not_reach_back_before_what_is_known():
    online = estimator(window=0.1)
    for k in range(200):
        feed(online, ('position', SECOND + k * 20_000_000, 0.0))
    std = online.belief.std
    plan = scenario.build({'model': 'mass_spring_damper'}).plan
    sensors = {name: timed.sensor for name, timed in plan.sensors.items()}
    online.configure(build_filter('kf', plan), sensors, Policy(window=10.0))
    assert feed(online, ('velocity', SECOND + 30_000_000, 0.0)) is Outcome.TOO_OLD
    np.testing.assert_array_equal(online.belief.std, std)
    assert online.restarts == 0


@pytest.mark.parametrize('kind', ['position', 'input'])
def test_stamps_are_refused_from_the_tolerance_on(kind):
    online, tolerance = estimator(future_tolerance=0.5), SECOND // 2

    def add(ahead):
        arrival = Arrival(None if kind == 'input' else kind, SECOND + ahead, np.zeros(1))
        return online.add([arrival], now=SECOND)[0][0]

    assert add(tolerance + 1) is Outcome.FUTURE
    assert online.time is None
    assert add(tolerance) is Outcome.FUSED
    assert online.time == SECOND + tolerance


def test_inputs_in_the_future_are_refused_too():
    """Else one would make every reading after it too old."""
    online = estimator()
    assert online.add_input(10 * SECOND, np.ones(1), now=SECOND) is Outcome.FUTURE
    assert online.add_input(SECOND, np.ones(1), now=SECOND) is Outcome.FUSED
    assert online.time == SECOND


def test_what_is_rejected_or_no_reading_at_first_is_no_restart():
    online = estimator(gates={'position': 1e-6})
    online.add_input(SECOND, np.ones(1))
    assert online.add_reading('position', SECOND, np.ones(1))[0] is Outcome.REJECTED
    assert online.add_reading('velocity', SECOND, np.ones(1))[0] is Outcome.FUSED
    assert online.restarts == 0
    online.restart()
    assert online.restarts == 1
    assert online.time is None


def test_starting_from_the_first_reading():
    online = estimator(from_reading=True)
    online.add_reading('position', SECOND, np.array([7.0]))
    np.testing.assert_allclose(online.belief.mean, [7.0, 0.0], atol=1e-12)
    assert online.belief.std[0] < 0.06


@settings(max_examples=2 * settings.default.max_examples)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(['position', 'velocity', 'input']),
            st.integers(0, 2**60) | st.integers(0, 200).map(lambda k: k * 10_000_000),
            st.floats(width=64),
            st.none() | st.floats(width=64),
        ),
        max_size=40,
    ),
    st.sampled_from(['kf', 'ekf', 'ukf']),
)
@pytest.mark.slow
def test_whatever_comes_the_belief_is_valid_and_the_counts_add_up(hostile, filter):
    online = estimator(gates={'position': 9.0}, filter=filter, window=1.0, recover_after=2)
    sent = Counter()
    with np.errstate(all='ignore'):
        for kind, time, value, variance in hostile:
            if kind == 'input':
                online.add_input(time, np.array([value]))
            else:
                R = None if variance is None else np.array([[variance]])
                online.add_reading(kind, time, np.array([value]), R)
                sent[kind] += 1
            assert np.isfinite(online.belief.mean).all()
            assert np.isfinite(online.belief.covariance).all()
            assert np.linalg.eigvalsh(online.belief.covariance)[0] > -1e-9 * np.max(
                np.abs(online.belief.covariance)
            )
    for name in ('position', 'velocity'):
        assert sum(online.counts[name].values()) == sent[name]


def first_reading(sensor, state, belief, y):
    """Return the belief after one reading by which the estimator starts."""
    system = LinearSystem(
        np.zeros((state.size, state.size)), np.zeros((state.size, 0)), np.eye(state.size), state,
        Space((), ()),
    )  # fmt: skip
    filter = ExtendedKalmanFilter(system)
    online = OnlineEstimator(filter, {'y': sensor}, belief, np.zeros(0), Policy(from_reading=True))
    assert online.add_reading('y', SECOND, y)[0] is Outcome.FUSED
    return online.belief


MOTION = Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s'))


@pytest.mark.parametrize('seed', range(8))
def test_starting_from_the_first_reading_of_a_radar_far_away(seed):
    rng = np.random.default_rng(seed)
    sensor = Radar(MOTION, [0.3, 0.03, 0.3])
    truth = rng.normal(size=4) * [40.0, 40.0, 5.0, 5.0]
    belief = Gaussian(rng.normal(size=4) * [20.0, 20.0, 1.0, 1.0], np.diag([900, 900, 25, 25.0]))
    y = sensor.measure(truth)
    found = first_reading(sensor, MOTION, belief, y)
    r = np.hypot(*truth[:2])
    # range and bearing are the place, whatever was believed
    np.testing.assert_allclose(found.mean[:2], truth[:2], atol=1e-3 * r)
    np.testing.assert_allclose(sensor.measure(found.mean)[2], y[2], atol=0.1)
    assert np.all(found.std[:2] < 0.3 + 0.04 * r)


@pytest.mark.parametrize('angle', [0.1, 1.5, 2.5, 3.1, -1.0, -3.0])
def test_starting_from_the_first_reading_of_a_bearing(angle):
    sensor = Bearing(MOTION, [0.02])
    belief = Gaussian(np.array([30.0, 1.0, 0.0, 0.0]), np.diag([400.0, 100.0, 1.0, 1.0]))
    found = first_reading(sensor, MOTION, belief, np.array([angle]))
    np.testing.assert_allclose(sensor.measure(found.mean), [angle], atol=1e-6)
    if angle == 0.1:  # the likeliest of all places in that direction
        line = np.array([np.cos(angle), np.sin(angle)])
        information = line / [400.0, 100.0]
        distance = (information @ [30.0, 1.0]) / (information @ line)
        np.testing.assert_allclose(found.mean[:2], distance * line, rtol=1e-6)


@pytest.mark.parametrize('filter', ['kf', 'ekf', 'ukf', 'steady_state', 'luenberger'])
@pytest.mark.parametrize('std', [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)])
@pytest.mark.parametrize('from_reading', [False, True])
def test_a_certain_belief_is_one_like_another(filter, std, from_reading):
    exact, nearly = estimator(filter=filter), estimator(filter=filter)
    exact._policy = nearly._policy = replace(exact._policy, from_reading=from_reading)
    exact.reset(Gaussian(np.array([0.5, 0.0]), np.diag(np.square(std))))
    nearly.reset(Gaussian(np.array([0.5, 0.0]), np.diag(np.square(std) + 1e-12)))
    for k in range(60):
        for online in (exact, nearly) if not from_reading or k else (exact,):
            assert feed(online, ('velocity', SECOND + k * 20_000_000, 0.3)) is Outcome.FUSED
            assert feed(online, ('position', SECOND + k * 20_000_000, 0.4)) is Outcome.FUSED
        assert np.linalg.eigvalsh(exact.belief.covariance)[0] >= -1e-15
    assert exact.restarts == 0
    assert exact.repairs <= 1
    if not from_reading:
        np.testing.assert_allclose(exact.belief.mean, nearly.belief.mean, atol=1e-6)
        np.testing.assert_allclose(exact.belief.covariance, nearly.belief.covariance, atol=1e-6)
