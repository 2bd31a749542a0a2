# SPDX-License-Identifier: Apache-2.0
"""Whose fault a rejected reading is: of the sensor that contradicts, or of the estimate."""

import numpy as np
import pytest

from kalman_ros.core import Gaussian, LinearSystem, Sensor, Space
from kalman_ros.estimators.agreement import Record, judge, seen_states
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.sensors.bearing import Bearing
from kalman_ros.sensors.states import States

SECOND = 1_000_000_000
NO_INPUT = np.zeros(0)
PLANE = LinearSystem(
    np.kron([[0.0, 1.0], [0.0, 0.0]], np.eye(2)),
    np.zeros((4, 0)),
    np.diag([0.0, 0.0, 0.01, 0.01]),
    Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s')),
    Space((), ()),
)
POSE = LinearSystem(
    np.zeros((3, 3)),
    np.zeros((3, 0)),
    1e-4 * np.eye(3),
    Space(('x', 'y', 'psi'), ('m', 'm', 'rad'), angles=('psi',)),
    Space((), ()),
)
RECOVER_AFTER = 20


def positions(*names, measures=('x', 'y')):
    return {
        name: named(States(PLANE.state, [0.3] * len(measures), measures), name) for name in names
    }


def named(sensor, name):
    sensor.name = name
    return sensor


def estimator(filter, sensors, initial, recover_after=RECOVER_AFTER, **options):
    gates = {n: chi_square_gate(0.999, s.output.size) for n, s in sensors.items()}
    policy = Policy(gates=gates, recover_after=recover_after, **options)
    return OnlineEstimator(filter, sensors, initial, NO_INPUT, policy)


def readings(sensors, rates, seconds, seed=0, offsets=None, outliers=0.0):
    """Yield (name, time, reading, truth) of a target that moves through the plane."""
    rng = np.random.default_rng(seed)
    x = np.array([0.0, 0.0, 1.0, 0.5])
    for k in range(round(seconds * 100)):
        for name, sensor in sensors.items():
            if k % round(100 / rates[name]) == 0:
                noise = 0.3 * rng.normal(size=sensor.output.size)
                if name == 'good' and rng.random() < outliers:
                    noise = noise + 20.0
                y = sensor.measure(x) + noise + (offsets or {}).get(name, 0.0)
                yield name, SECOND + k * SECOND // 100, y, x
        x = PLANE.step(x, NO_INPUT, 0.01)


def track(names, rates, seconds=12.0, *, recover_after=RECOVER_AFTER, dies=np.inf, **options):
    """Return the root mean square error of position, after each reading, and the estimator."""
    sensors = positions(*names)
    initial = Gaussian(np.zeros(4), np.eye(4))
    online = estimator(KalmanFilter(PLANE), sensors, initial, recover_after)
    errors = []
    for name, time, y, x in readings(sensors, rates, seconds, **options):
        if name != 'good' or time < dies * 1e9:
            online.add_reading(name, time, y)
            errors.append(np.sum((online.belief.mean - x)[:2] ** 2))
    return np.sqrt(np.mean(errors)), online


@pytest.mark.parametrize('names', [('good', 'liar'), ('liar', 'good')])
def test_of_two_that_see_the_same_the_one_that_contradicts_stays_rejected(names):
    rates, offsets = {'good': 10.0, 'liar': 10.0}, {'liar': 50.0}
    right, _ = track(names, rates, recover_after=0, offsets=offsets)
    error, online = track(names, rates, offsets=offsets)
    assert error <= 1.2 * right
    assert online.contradicting == ['liar']
    assert online.counts['liar'][Outcome.OUTVOTED] > 80
    assert Outcome.RECOVERED not in online.counts['liar']
    assert not Outcome.OUTVOTED.accepted


@pytest.mark.slow
@pytest.mark.parametrize(('outliers', 'seconds'), [(0.0, 12.0), (0.1, 30.0)])
def test_the_liar_may_be_fast_and_the_honest_sensor_slow(outliers, seconds):
    rates, offsets = {'good': 1.0, 'liar': 100.0}, {'liar': 50.0}
    error, online = track(
        ('good', 'liar'), rates, seconds, offsets=offsets, outliers=outliers, seed=3
    )
    assert error < 2.0
    assert Outcome.RECOVERED not in online.counts['liar']
    assert bool(online.counts['good'][Outcome.REJECTED]) == bool(outliers)


def test_who_is_left_alone_is_alone():
    rates, offsets = {'good': 10.0, 'liar': 10.0}, {'liar': 50.0}
    _, online = track(('good', 'liar'), rates, 20.0, offsets=offsets, dies=10.0)
    counts = online.counts['liar']
    assert counts[Outcome.RECOVERED] == 1
    assert online.contradicting == []
    assert np.hypot(*(online.belief.mean[:2] - [70.0, 60.0])) < 1.0
    # ten intervals after the last word of the other, not before
    assert 95 <= counts[Outcome.REJECTED] + counts[Outcome.OUTVOTED] <= 105


def test_an_estimate_that_both_contradict_recovers_after_so_many_readings_in_total():
    sensors = positions('one', 'other')
    wrong = Gaussian(np.array([50.0, 50.0, 0.0, 0.0]), 1e-4 * np.eye(4))
    online = estimator(KalmanFilter(PLANE), sensors, wrong)
    outcomes = []
    for name, time, y, x in readings(sensors, {'one': 10.0, 'other': 10.0}, 6.0):
        outcomes.append(online.add_reading(name, time, y)[0])
        truth = x
    assert outcomes[: RECOVER_AFTER - 1] == [Outcome.REJECTED] * (RECOVER_AFTER - 1)
    assert outcomes[RECOVER_AFTER - 1] is Outcome.RECOVERED
    # the speed, which was as wrong, takes some readings more
    assert set(outcomes[-2 * RECOVER_AFTER :]) == {Outcome.FUSED}
    assert np.hypot(*(online.belief.mean - truth)[:2]) < 0.5


def test_a_sensor_that_agrees_does_not_vouch_for_what_it_does_not_see():
    sensors = {**positions('speed', measures=('v_x', 'v_y')), **positions('place')}
    wrong = Gaussian(np.array([50.0, 50.0, 1.0, 0.5]), 1e-4 * np.eye(4))
    online = estimator(KalmanFilter(PLANE), sensors, wrong)
    outcomes = {name: [] for name in sensors}
    for name, time, y, _ in readings(sensors, {'speed': 10.0, 'place': 10.0}, 4.0):
        before = online.belief.std[2]
        outcomes[name].append(online.add_reading(name, time, y)[0])
        if outcomes[name][-1] is Outcome.RECOVERED:
            # what the other vouches for is as certain as it was
            assert online.belief.std[2] < 1.1 * before + 0.05
    assert outcomes['place'][:RECOVER_AFTER].count(Outcome.REJECTED) == RECOVER_AFTER - 1
    assert outcomes['place'][RECOVER_AFTER - 1] is Outcome.RECOVERED
    assert set(outcomes['speed']) == {Outcome.FUSED}


class Landmark(Sensor):
    """Range and bearing of a landmark, as a robot in the plane sees it."""

    def __init__(self, at):
        self.at = np.array(at)
        self.output = Space(('range', 'bearing'), ('m', 'rad'), angles=('bearing',))
        self.covariance = np.diag([0.1**2, 0.05**2])

    def measure(self, x):
        dx, dy = np.moveaxis(self.at - x[..., :2], -1, 0)
        angle = np.arctan2(dy, dx) - x[..., 2]
        return self.output.wrap(np.stack((np.hypot(dx, dy), angle), axis=-1))

    def jacobian(self, x):
        dx, dy = self.at - x[:2]
        r = np.hypot(dx, dy)
        return np.array([[-dx / r, -dy / r, 0.0], [dy / r**2, -dx / r**2, -1.0]])


def located(start, seed):
    """Return the error of position at the end of six looks at 15 landmarks, and the estimator."""
    rng = np.random.default_rng(seed)
    sensors = {f'l{k}': named(Landmark(rng.uniform(-6, 6, 2)), f'l{k}') for k in range(15)}
    online = estimator(ExtendedKalmanFilter(POSE), sensors, start)
    errors = []
    for k in range(60):
        for name, sensor in sensors.items():
            noise = rng.normal(size=2) * [0.1, 0.05]
            y = sensor.output.wrap(sensor.measure(np.zeros(3)) + noise)
            online.add_reading(name, SECOND + k * SECOND // 10, y)
        errors.append(np.hypot(*online.belief.mean[:2]))
    return np.sqrt(np.mean(np.square(errors[30:]))), online


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
def test_of_many_landmarks_each_counts(seed):
    P = np.diag([0.05, 0.05, 0.1]) ** 2
    right, _ = located(Gaussian(np.zeros(3), P), seed)
    error, online = located(Gaussian(np.array([3.0, 0.0, np.pi / 2]), P), seed)
    assert error <= 1.2 * right
    assert online.belief.std[0] < 0.05
    rejected = sum(counts[Outcome.REJECTED] for counts in online.counts.values())
    assert rejected < 6 * RECOVER_AFTER
    assert sum(counts[Outcome.RECOVERED] for counts in online.counts.values()) >= 1


@pytest.mark.slow
def test_late_readings_that_contradict_change_nothing():
    sensors = positions('good', 'liar', 'third')
    rates = {'good': 10.0, 'liar': 25.0, 'third': 5.0}
    given = list(readings(sensors, rates, 4.0, offsets={'liar': 50.0}))
    # for a while, all contradict
    given = [(n, t, y + 30.0 * (t > 3 * SECOND), x) for n, t, y, x in given]
    found = []
    for order in (range(len(given)), np.random.default_rng(1).permutation(len(given))):
        initial = Gaussian(np.zeros(4), np.eye(4))
        online = estimator(KalmanFilter(PLANE), sensors, initial, window=10.0)
        for k in order:
            online.add_reading(*given[k][:3])
        found.append(online)
    in_order, shuffled = found
    assert in_order.counts == shuffled.counts
    assert in_order.contradicting == shuffled.contradicting
    np.testing.assert_array_equal(in_order.belief.mean, shuffled.belief.mean)
    np.testing.assert_array_equal(in_order.belief.covariance, shuffled.belief.covariance)
    outcomes = {o for counts in in_order.counts.values() for o in counts}
    assert {Outcome.FUSED, Outcome.REJECTED, Outcome.OUTVOTED, Outcome.RECOVERED} <= outcomes


@pytest.mark.parametrize(
    ('agreeing', 'contradicting', 'vouched'),
    [(1, 1, True), (1, 2, True), (1, 3, False), (5, 10, True), (4, 11, False), (0, 2, False)],
)
def test_a_few_that_agree_by_chance_do_not_vouch(agreeing, contradicting, vouched):
    records = [Record().after(SECOND, agrees=True)] * agreeing
    records += [Record().after(SECOND, agrees=False)] * contradicting
    seen = np.ones((len(records), 1), dtype=bool)
    found = judge(records, seen, len(records) - 1, 100)
    assert found.vouched[0] == found.outvoted == vouched
    assert not found.enough


@pytest.mark.parametrize(
    ('own', 'other', 'needed', 'enough'),
    [(500, 9, 20, False), (10, 10, 20, True), (500, 9, 21, False), (11, 10, 21, True)],
)
def test_none_counts_for_more_than_half(own, other, needed, enough):
    records = [
        Record(SECOND, SECOND // 10, agrees=False, rejections=own),
        Record(SECOND, SECOND // 10, agrees=False, rejections=other),
    ]
    seen = np.ones((2, 1), dtype=bool)
    assert judge(records, seen, 0, needed).enough is enough


def test_how_long_a_sensor_counts():
    record = Record()
    assert not record.is_expected(SECOND)
    record = record.after(SECOND, agrees=True)
    assert record.is_expected(10_000 * SECOND)  # its interval is unknown
    assert not record.is_expected(62 * SECOND, longest=60 * SECOND)
    slow = record.after(3 * SECOND, agrees=True)
    assert slow.is_expected(23 * SECOND)
    assert not slow.is_expected(23 * SECOND + 1)
    fast = record.after(SECOND + 1000, agrees=False)
    assert fast.is_expected(2 * SECOND + 1000)
    assert not fast.is_expected(2 * SECOND + 1001)


def test_a_bearing_along_an_axis_sees_both_coordinates():
    sensor = Bearing(PLANE.state, [0.1])
    belief = Gaussian(np.array([10.0, 0.0, 0.0, 0.0]), np.eye(4))
    assert sensor.jacobian(belief.mean)[0, 0] == 0.0
    np.testing.assert_array_equal(
        seen_states({'bearing': sensor}, belief), [[True, True, False, False]]
    )
