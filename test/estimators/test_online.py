# SPDX-License-Identifier: Apache-2.0
"""Order, late data and the account of every reading."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalman_ros import models, sensors
from kalman_ros.core import Gaussian
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.online import OnlineEstimator, Outcome

SECOND = 1_000_000_000


def estimator(window=10.0, gates=None):
    system = models.system('mass_spring_damper')
    model = system.build()
    built = {
        name: sensors.build(setup.kind, model.state, setup.noise, setup.options)
        for name, setup in system.sensors.items()
    }
    return OnlineEstimator(
        build_filter('kf', model),
        built,
        Gaussian(np.zeros(2), np.eye(2)),
        np.zeros(1),
        window=window,
        gates=gates,
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


@settings(max_examples=150, deadline=None)
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
