# SPDX-License-Identifier: Apache-2.0
"""What arrives together is fused as if it came one after the other, at the cost of one pass."""

import numpy as np
import pytest

from kalman_ros.core import Gaussian, LinearSystem, Space
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.sensors.linear import Linear

MS = 1_000_000


class Counting(KalmanFilter):
    """Counts its corrections."""

    corrections = 0

    def correct(self, belief, y, sensor):
        """Correct, and count it."""
        Counting.corrections += 1
        return super().correct(belief, y, sensor)


@pytest.fixture
def make():
    state = Space(('x', 'v'), ('m', 'm/s'))
    model = LinearSystem(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), state, Space(('a',), ('m/s^2',))
    )
    sensors = {name: Linear(state, [0.3], [1.0, 0.0]) for name in ('near', 'far')}
    policy = Policy(gates={'near': 6.6, 'far': 6.6})

    def build():
        Counting.corrections = 0
        first = Gaussian(np.zeros(2), np.eye(2))
        return OnlineEstimator(Counting(model), sensors, first, np.zeros(1), policy)

    return build


def stream(count, rng):
    """Return what arrives: readings and inputs, some twice, some late, some far off."""
    found = []
    for k in range(count):
        time = int(k * 5 + rng.integers(-40, 1)) * MS + 1_000 * MS
        if rng.random() < 0.2:
            found.append(Arrival(None, time, rng.standard_normal(1)))
        else:
            y = 0.3 * rng.standard_normal(1) + 20.0 * (rng.random() < 0.05)
            found.append(Arrival(str(rng.choice(['near', 'far'])), time, y))
        if rng.random() < 0.05:
            found.append(found[-1])
    return found


@pytest.mark.parametrize('seed', range(5))
def test_in_batches_it_is_the_same_to_the_last_bit(make, seed):
    rng = np.random.default_rng(seed)
    arrivals = stream(400, rng)
    single, together = make(), make()
    for arrival in arrivals:
        single.add([arrival])
    while arrivals:
        count = int(rng.integers(1, 60))
        together.add(arrivals[:count])
        del arrivals[:count]
    assert together.time == single.time
    for one, other in zip(together.belief[:2], single.belief[:2]):
        np.testing.assert_array_equal(one, other)
    counts = [{name: +found for name, found in each.counts.items()} for each in (single, together)]
    assert counts[0] == counts[1]
    assert counts[0]['near'][Outcome.REJECTED] and counts[0]['near'][Outcome.DUPLICATE]


def test_late_readings_that_come_together_cost_one_pass(make):
    estimator = make()
    number = 100
    estimator.add([Arrival('near', (1_000 + 5 * k) * MS, np.zeros(1)) for k in range(number)])
    Counting.corrections = 0
    estimator.add([Arrival('far', (1_000 + 5 * k) * MS, np.zeros(1)) for k in range(number)])
    assert Counting.corrections <= 2 * number  # one after the other: 5,000


def test_a_reading_on_which_the_model_fails_is_left_out_and_the_others_stay(make):
    estimator = make()
    estimator.add_reading('near', 1_000 * MS, np.zeros(1))
    before, filter = estimator.belief, estimator._filter

    class Broken(Counting):
        def correct(self, belief, y, sensor):
            raise RuntimeError('of a model')

    estimator._filter = Broken(filter.model)
    with pytest.raises(RuntimeError, match='of a model'):
        estimator.add_reading('near', 1_010 * MS, np.zeros(1))
    estimator._filter = filter
    assert estimator.belief is before
    assert estimator.add_reading('near', 1_020 * MS, np.zeros(1))[0] is Outcome.FUSED
