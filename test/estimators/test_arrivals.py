# SPDX-License-Identifier: Apache-2.0
"""Many arrivals at once are what they are one after the other."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalman_ros import scenario
from kalman_ros.core import Gaussian
from kalman_ros.core.ordered_data import FirstSteps
from kalman_ros.estimators.arrivals import Arrivals
from kalman_ros.estimators.filter import committed
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.timeline import Arrival

SECOND = 1_000_000_000
NAMES = 'position', 'velocity'
GATES = {'position': 9.0, 'velocity': 9.0}


@dataclass(frozen=True)
class StepByStep(ExtendedKalmanFilter):
    """An extended filter whose first steps are its predictions and corrections."""

    has_first_steps = True

    def first_steps(self, belief, data, sensors, limits):
        means, covariances, first = [], [], belief
        results = [([], [], []) for _ in sensors]
        for k, dt in enumerate(data.dt.tolist()):
            start = int(data.start[k])
            belief = first if start < 0 else Gaussian(means[start], covariances[start])
            if dt:
                belief = self.predict(belief, data.inputs[data.input[k]], dt)
            s = int(data.sensor[k])
            if s >= 0:
                at = data.row[k]
                sensor = sensors[s].with_covariance(data.covariances[s][at])
                correction = self.correct(belief, data.readings[s][at], sensor)
                if correction.nis > limits[s]:
                    break
                belief, _ = committed(correction.posterior)
                row = correction.innovation, correction.innovation_covariance, correction.nis
                for kept, value in zip(results[s], row):
                    kept.append(value)
            means.append(belief.mean)
            covariances.append(belief.covariance)
        columns = ([np.array(kept) for kept in each] for each in zip(*results))
        return FirstSteps(np.array(means), np.array(covariances), *columns)


def estimator(filter=None, **options):
    built = scenario.build({'model': 'mass_spring_damper'})
    sensors = {name: built.sensors[name].sensor for name in NAMES}
    return OnlineEstimator(
        filter or StepByStep(built.model), sensors, Gaussian(np.zeros(2), np.eye(2)),
        np.zeros(1), Policy(**options),
    )  # fmt: skip


def one_by_one(online, rows):
    """Add rows of source, stamp, now and value; return what became of each."""
    results = []
    for source, stamp, now, value in rows:
        name = NAMES[source] if source < 2 else None
        outcome, correction = online.add([Arrival(name, stamp, np.array([value]))], now)[0]
        innovation = None if correction is None else correction.innovation.copy()
        results.append((outcome, innovation, *map(np.copy, online.belief), online.time))
    return results


def at_once(online, rows, most=40):
    """Add the same rows, as many at once as possible; return also how many were."""
    source = np.array([row[0] for row in rows])
    stamps = np.array([row[1:3] for row in rows], dtype=np.int64).reshape(-1, 2)
    values = [np.array([[row[3]] for row in rows if row[0] == s]).reshape(-1, 1) for s in range(3)]
    row = np.zeros(len(rows), dtype=int)
    for s in range(3):
        row[source == s] = np.arange(len(values[s]))
    R = [np.broadcast_to(online.sensors[name].covariance, (len(values[s]), 1, 1))
         for s, name in enumerate(NAMES)]  # fmt: skip
    arrivals = Arrivals(stamps[:, 0], stamps[:, 1], source, row, values, R)
    results, together, at = [], 0, 0
    while at < len(rows):
        steps = online.add_first(arrivals.some(slice(at, at + most)))
        count = 0 if steps is None else len(steps.time)
        if not count:
            results += one_by_one(online, rows[at : at + 1])
            at += 1
            continue
        read = [0, 0]
        for k in range(count):
            s, innovation = int(source[at + k]), None
            if s < 2:
                innovation, read[s] = steps.innovation[s][read[s]], read[s] + 1
            belief = steps.mean[k], steps.covariance[k]
            results.append((Outcome.FUSED, innovation, *belief, steps.time[k]))
        at, together = at + count, together + count
    return results, together


def same(first, second):
    assert [row[0] for row in first] == [row[0] for row in second]
    for one, other in zip(first, second):
        for a, b in zip(one[1:], other[1:]):
            assert (a is None) == (b is None)
            if a is not None:
                np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-13)


def rows_of(seed, count, *, late=0.0, wild=0.0, broken=0.0, gap=0.0):
    """Return readings and inputs of some seconds, with shares of those that need a decision."""
    rng, rows, time = np.random.default_rng(seed), [], 5 * SECOND
    for _ in range(count):
        time += int(rng.integers(1, 4)) * 5_000_000
        if rng.random() < gap:
            time += 20 * SECOND
        source = int(rng.choice([0, 1, 2], p=[0.6, 0.3, 0.1]))
        stamp = time - int(rng.integers(1, 60) * 5_000_000 * (rng.random() < late))
        value = float(rng.normal(scale=0.1)) + 1e3 * (rng.random() < wild)
        rows.append((source, stamp, time + 1_000_000,
                     value if rng.random() >= broken else np.nan))  # fmt: skip
    return rows


@pytest.mark.parametrize(
    ('troubles', 'options', 'least'),
    [
        ({}, {}, 190),
        ({'late': 0.05}, {}, 90),
        ({'wild': 0.03}, {'gates': GATES, 'recover_after': 4}, 90),
        ({'wild': 0.03}, {'soft_gates': GATES}, 90),
        ({'broken': 0.05}, {}, 90),
        ({'gap': 0.02}, {'max_gap': 5.0}, 90),
        ({'late': 0.05, 'wild': 0.03, 'broken': 0.02}, {'gates': GATES, 'window': 0.05}, 60),
        ({'late': 0.3}, {'restart_after': 3, 'window': 0.02}, 0),
        ({'late': 0.05}, {'restart_after': 0, 'window': 0.12}, 90),
    ],
)
def test_many_at_once_are_what_they_are_one_by_one(troubles, options, least):
    rows = rows_of(7, 200, **troubles)
    alone, many = estimator(**options), estimator(**options)
    expected = one_by_one(alone, rows)
    results, together = at_once(many, rows)
    same(expected, results)
    assert together >= least
    assert many.counts == alone.counts
    assert all({*many.counts[name]} == {*alone.counts[name]} for name in NAMES)
    assert (many.restarts, many.repairs, many.time) == (alone.restarts, alone.repairs, alone.time)
    assert many._timeline.head.records == alone._timeline.head.records


@pytest.mark.slow
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.02, 0.5, 1.0]), st.integers(10, 90))
def test_what_comes_late_afterwards_changes_the_same(seed, window, most):
    rows = rows_of(seed, 60, late=0.1, wild=0.02)
    more = [(0, rows[-1][1] - ago, rows[-1][2], 0.3) for ago in (3_000_000, 203_000_000)]
    alone, many = (estimator(window=window, gates=GATES) for _ in range(2))
    expected = one_by_one(alone, rows + more)
    results, _ = at_once(many, rows, most)
    same(expected, results + one_by_one(many, more))


@pytest.mark.parametrize(('ago', 'together'), [(110, 61), (130, 60)])
def test_a_reading_before_the_window_is_too_late(ago, together):
    rows = [(0, SECOND + k * 10_000_000, SECOND + k * 10_000_000, 0.1) for k in range(60)]
    rows.append((1, rows[-1][1] - ago * 1_000_000, rows[-1][2], 0.2))
    alone, many = (estimator(window=0.12) for _ in range(2))
    results, count = at_once(many, rows, 200)
    same(one_by_one(alone, rows), results)
    assert count == together - 1  # the first has no belief before it


def test_a_silent_sensor_has_no_count_and_the_window_keeps_what_may_still_change():
    rows = [row for row in rows_of(3, 120) if row[0] != 1]
    online = estimator(window=0.05)
    results, together = at_once(online, rows)
    assert together > 60
    assert [*online.counts['velocity']] == []
    base, items = online._timeline._base, online._timeline._items
    assert base.time < items[0].key[0]
    assert 2 <= len(items) <= 11 and results[-1][4] == items[-1].key[0]


@pytest.mark.parametrize('option', [{'from_rest': True}, {'adaptive': ('position',)}])
def test_decisions_about_every_reading_are_made_one_by_one(option):
    rows = rows_of(3, 60)
    _, together = at_once(estimator(**option), rows)
    assert together == 0


def test_items_that_are_final_are_handed_over_one_by_one():
    online = estimator()
    online.on_final = lambda items: None
    assert at_once(online, rows_of(3, 60))[1] == 0


def test_a_filter_without_first_steps_takes_them_one_by_one():
    built = scenario.build({'model': 'mass_spring_damper'})
    online = estimator(ExtendedKalmanFilter(built.model))
    assert at_once(online, rows_of(3, 60))[1] == 0
