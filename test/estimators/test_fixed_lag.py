# SPDX-License-Identifier: Apache-2.0
"""The smoother at a fixed lag is the smoother of a recording that ends there."""

from dataclasses import replace

import numpy as np
import pytest
from random_systems import random_problem
from test_on_rotations import MODEL, NOTHING, START, TURN, Attitude
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.estimators.fixed_lag import FixedLagSmoother
from kalman_ros.estimators.instants import Instants
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.smoother import StepBack, smooth
from kalman_ros.estimators.timeline import Item, State
from kalman_ros.scenario import Scenario


def steps_of(online, feed):
    """Return the instants of an estimator that is fed, with their filters."""
    found, instants = [], Instants()
    online.on_final = lambda items: found.extend(instants.take(items))
    feed(online)
    online.finish()
    found.extend(instants.finish())
    return found


def random_steps(seed, count=120):
    """Return the steps of a random linear system with uneven times."""
    rng, system, sensor, prior = random_problem(seed)
    plan = Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0)
    filter = build_filter('kf', plan, {})
    online = OnlineEstimator(filter, {'y': sensor}, prior, np.zeros(2), Policy(window=0.0))
    times = np.cumsum(rng.integers(20_000_000, 150_000_000, count)).tolist()

    def feed(estimator):
        for time in times:
            estimator.add_input(time, rng.normal(size=2))
            estimator.add_reading('y', time, rng.normal(size=2))

    return system.state, steps_of(online, feed)


def emitted(space, steps, lag):
    """Return each belief with its time and the number of steps that it was computed from."""
    smoother, result = FixedLagSmoother(space, lag), []
    for count, (step, filter) in enumerate(steps, start=1):
        result += [(time, belief, count) for time, belief in smoother.add(step, filter)]
    return result, smoother


def same(ours, theirs, tolerance=1e-9):
    scale = np.sqrt(np.abs(theirs.covariance.diagonal()))
    assert np.abs((ours.mean - theirs.mean) / scale).max() < tolerance
    change = (ours.covariance - theirs.covariance) / np.outer(scale, scale)
    assert np.abs(change).max() < tolerance


@pytest.mark.parametrize('lag', [1e-9, 0.3, 2.0])
@pytest.mark.parametrize('seed', range(2))
def test_each_belief_is_that_of_the_batch_smoother(seed, lag):
    space, steps = random_steps(seed)
    found, _ = emitted(space, steps, lag)
    times = [step.time for step, _ in steps]
    assert [time for time, _, _ in found] == times[: len(found)]
    assert len(found) > 80
    filtered = [step for step, _ in steps]
    for k, (time, belief, count) in enumerate(found):
        # the first step that is late enough, and not one later
        assert times[count - 1] - time >= round(lag * 1e9) > times[count - 2] - time
        if k % 9 == 0:
            same(belief, smooth(steps[0][1], filtered[:count])[k])


@pytest.mark.slow
@pytest.mark.parametrize('name', ['turn_rate', 'cart_pole', 'lidar_radar', 'robot_3d', 'inertial'])
def test_nonlinear_filters_angles_and_rotations(name):
    scenario: Scenario = kr.load(name)
    run = kr.simulate(name, seconds=3, seed=2)
    plan = scenario.plan
    filter = build_filter(scenario.filter, plan, {})
    sensors = {key: source.sensor for key, source in scenario.enabled.items()}
    zero = np.zeros(scenario.model.input.size)
    initial = scenario.initial_belief
    online = OnlineEstimator(filter, sensors, initial, zero, Policy(window=0.0))

    def feed(estimator):
        rows = [
            (round(time * 1e9), key, values)
            for key, series in run.readings.items()
            for time, values in zip(series.time, series.values)
        ]
        for time, key, values in sorted(rows, key=lambda row: row[0]):
            estimator.add_reading(key, time, values)

    steps = steps_of(online, feed)
    found, smoother = emitted(scenario.model.state, steps, 0.5)
    filtered = [step for step, _ in steps]
    for k in range(0, len(found), max(1, len(found) // 6)):
        _, belief, count = found[k]
        same(belief, smooth(filter, filtered[:count])[k])
    # what is left in the end has the readings to the end
    rest = [belief for _, belief in smoother.finish()]
    whole = smooth(filter, filtered)
    assert len(found) + len(rest) == len(whole)
    for ours, theirs in zip(rest, whole[len(found) :]):
        same(ours, theirs)


def test_a_lag_that_is_met_exactly_has_passed():
    _, system, sensor, prior = random_problem(5)
    filter = build_filter('kf', Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0), {})
    online = OnlineEstimator(filter, {'y': sensor}, prior, np.zeros(2), Policy(window=0.0))

    def feed(estimator):
        for k in range(30):
            estimator.add_reading('y', k * 100_000_000, np.zeros(2))

    found, _ = emitted(system.state, steps_of(online, feed), 0.5)
    assert [count - k for k, (_, _, count) in enumerate(found)] == [6] * 25


@pytest.mark.slow
def test_a_heading_that_goes_round():
    scenario = kr.load('turn_rate')
    heading = scenario.model.state.names.index(scenario.model.state.angles[0])
    mean = scenario.initial_belief.mean.copy()
    mean[heading] = np.pi - 0.01
    filter = build_filter(scenario.filter, scenario.plan, {})
    sensors = {key: source.sensor for key, source in scenario.enabled.items()}
    initial = Gaussian(mean, scenario.initial_belief.covariance)
    online = OnlineEstimator(filter, sensors, initial, np.zeros(0), Policy(window=0.0))
    truth = mean.copy()
    rng = np.random.default_rng(3)

    def feed(estimator):
        for k in range(60):
            # it turns about the place where the angle jumps
            truth[heading] = np.pi + 0.3 * np.sin(0.2 * k)
            truth[:2] += 0.1
            for name, sensor in sensors.items():
                noise = np.sqrt(sensor.covariance.diagonal()) * rng.normal(size=sensor.output.size)
                estimator.add_reading(name, k * 100_000_000, sensor.measure(truth) + noise)

    steps = steps_of(online, feed)
    angles = np.array([step.belief.mean[heading] for step, _ in steps])
    assert np.abs(np.diff(angles)).max() > 6.0  # it was crossed
    filtered = [step for step, _ in steps]
    found, _ = emitted(scenario.model.state, steps, 1.0)
    for k, (_, belief, count) in enumerate(found):
        same(belief, smooth(filter, filtered[:count])[k])


def test_an_instant_has_the_last_belief_and_any_restart():
    _, steps = random_steps(6, 10)
    belief, filter = steps[0][0].belief, steps[0][1]

    def item(time, restarted=False):
        one = Item((time, 0, time), np.zeros(2), None, filter)
        one.after = State(time, belief, np.zeros(2), ())
        one.restarted = restarted
        return one

    instants = Instants()
    found = [*instants.take([item(1), item(2, True), item(2), item(3)]), *instants.finish()]
    assert [(step.time, step.restarted) for step, _ in found] == [
        (1, True), (2, True), (3, False),
    ]  # fmt: skip
    # a clock that goes back, and what comes after the end, are independent of the past
    found = [*instants.take([item(5), item(4)]), *instants.finish()]
    assert [(step.time, step.restarted) for step, _ in found] == [(5, True), (4, True)]


def test_late_readings_change_nothing_but_the_time_of_the_answer():
    rng, system, sensor, prior = random_problem(7)
    filter = build_filter('kf', Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0), {})
    rows = [(k * 50_000_000, rng.normal(size=2)) for k in range(80)]

    def smoothed(order):
        policy = Policy(window=1.0)
        online = OnlineEstimator(filter, {'y': sensor}, prior, np.zeros(2), policy)

        def feed(estimator):
            for k in order:
                estimator.add_reading('y', *rows[k])

        return emitted(system.state, steps_of(online, feed), 0.5)[0]

    late = sorted(range(80), key=lambda k: k + 4 * (k % 7 == 3))
    for (time, ours, _), (other, theirs, _) in zip(
        smoothed(range(80)), smoothed(late), strict=True
    ):
        assert time == other
        np.testing.assert_array_equal(ours.mean, theirs.mean)
        np.testing.assert_array_equal(ours.covariance, theirs.covariance)


def test_nothing_is_carried_over_a_restart():
    space, steps = random_steps(1)
    broken = list(steps)
    step, filter = broken[60]
    broken[60] = replace(step, restarted=True), filter
    found, _ = emitted(space, broken, 1.0)
    filtered = [step for step, _ in broken]
    before = smooth(filter, filtered[:60])
    for k in range(60):
        assert found[k][0] == filtered[k].time
        if found[k][2] == 61:  # it has all readings before the restart
            same(found[k][1], before[k])
    assert found[59][2] == 61


def test_the_cost_of_a_step_does_not_depend_on_the_lag(monkeypatch):
    space, steps = random_steps(2)
    composed = []
    after = StepBack.after
    monkeypatch.setattr(
        StepBack, 'after', lambda self, later: composed.append(1) or after(self, later)
    )
    counts = []
    for lag in (0.2, 1.0, 4.0):
        composed.clear()
        emitted(space, steps, lag)
        counts.append(len(composed) / len(steps))
    assert max(counts) < 3.2, counts


def attitude_steps(std, far=0.0, count=100):
    """Return the steps of a body that tumbles, whose readings have a deviation of ``std``."""
    rng = np.random.default_rng(3)
    sensor = Attitude(std)
    filter = build_filter('ekf', Plan(MODEL, {'y': TimedSensor(sensor, 10.0)}, 10.0), {})
    initial = Gaussian(START + far * np.eye(6)[0], (far**2 + 0.05**2) * np.eye(6))
    online = OnlineEstimator(filter, {'y': sensor}, initial, NOTHING, Policy(window=0.0))

    def feed(estimator):
        truth = START
        for k in range(count):
            noise = std * rng.normal(size=6)
            reading = sensor.output.add(sensor.measure(truth), noise)
            estimator.add_reading('y', k * 20_000_000, reading)
            truth = TURN.add(truth, 0.02 * MODEL.derivative(truth, NOTHING))

    return steps_of(online, feed)


@pytest.mark.parametrize(('std', 'far'), [(0.01, 0.0), (0.15, 0.6), (0.3, 2.5)])
def test_rotations_near_and_far(std, far):
    steps = attitude_steps(std, far)
    found, smoother = emitted(TURN, steps, 0.6)
    filtered = [step for step, _ in steps]
    assert [count - k for k, (_, _, count) in enumerate(found)] == [31] * len(found)
    for k, (time, belief, count) in [*enumerate(found)][::11]:
        assert time == filtered[k].time
        whole = smooth(steps[0][1], filtered[:count])[k]
        change = TURN.subtract(belief.mean, filtered[k].belief.mean)
        assert np.linalg.norm(change[:3]) > 1e-4
        error = TURN.subtract(belief.mean, whole.mean)
        same(Gaussian(whole.mean + error, belief.covariance), whole)
    rest = list(smoother.finish())
    assert len(found) + len(rest) == len(filtered)
    same(rest[-1][1], filtered[-1].belief)


def test_the_step_back_of_rotations_is_that_of_differences_on_the_group():
    """The affine step is that of x_s' - x_p, to the second order of what later readings change."""
    steps = attitude_steps(0.05, far=0.3)
    filter, filtered = steps[0][1], [step for step, _ in steps]
    smoothed = smooth(filter, filtered)
    for k in (0, 1, 10, 30):
        step, after = filtered[k], smoothed[k + 1]
        predicted, F, _ = filter.linearized(step.belief, step.input, 0.02)
        C = step.belief.covariance @ F.T @ np.linalg.inv(predicted.covariance)
        x = step.belief.mean
        expected = TURN.reached(x + C @ TURN.subtract(after.mean, predicted.mean), x)
        assert np.linalg.norm(TURN.subtract(smoothed[k].mean, expected)[:3]) < 2e-5


@pytest.mark.parametrize('lag', [0.1, 0.3])
def test_what_stays_unknown_is_not_smoothed(lag):
    """A velocity alone says nothing of the position."""
    problem = kr.make_scenario(
        kr.continuous_model([[0.0, 1.0], [0.0, 0.0]], W=np.diag([0.1, 0.1])),
        {'v': ([0.0, 1.0], 0.1)},
        rate=10.0,
    )
    filter, sensors = build_filter('kf', problem.plan), {'v': problem.sensors['v'].sensor}
    nowhere = Gaussian(np.zeros(2), np.diag([np.inf, np.inf]))
    online = OnlineEstimator(filter, sensors, nowhere, np.zeros(0), Policy(window=0.0))

    def feed(estimator):
        for k in range(12):
            estimator.add_reading('v', k * 100_000_000, np.array([0.1 * k]))

    steps = steps_of(online, feed)
    found, _ = emitted(problem.model.state, steps, lag)
    assert len(found) > 5
    for k, (_, belief, _) in enumerate(found):
        np.testing.assert_array_equal(belief.mean, steps[k][0].belief.mean)
        assert np.isinf(belief.covariance).any()


def test_a_filter_that_cannot_be_smoothed_is_refused():
    space, steps = random_steps(0, 5)
    smoother = FixedLagSmoother(space, 1.0)
    assert list(smoother.add(steps[0][0], steps[0][1])) == []
    with pytest.raises(ValueError, match='fixed_lag: expected one of'):
        list(smoother.add(steps[1][0], object()))


def test_an_estimator_says_when_it_is_reset():
    _, system, sensor, prior = random_problem(3)
    filter = build_filter('kf', Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0), {})
    online = OnlineEstimator(filter, {'y': sensor}, prior, np.zeros(2), Policy())
    calls = []
    online.on_final = lambda items: calls.append(len(items)) if items else None
    online.on_reset = lambda: calls.append('reset')
    online.add_reading('y', 0, np.zeros(2))
    online.reset(prior)
    assert calls == [1, 'reset']


def test_a_state_of_which_nothing_is_known_is_not_smoothed():
    problem = kr.make_scenario(
        kr.continuous_model([[0.0, 1.0], [0.0, 0.0]], W=np.diag([0.1, 0.1])),
        {'y': ([1.0, 0.0], 0.1)},
        rate=10.0,
    )
    filter = build_filter('kf', problem.plan)
    sensors = {'y': problem.sensors['y'].sensor}
    nowhere = Gaussian(np.zeros(2), np.diag([np.inf, np.inf]))
    online = OnlineEstimator(filter, sensors, nowhere, np.zeros(0), Policy(window=0.0))

    def feed(estimator):
        for k in range(12):
            estimator.add_reading('y', k * 100_000_000, np.array([0.1 * k]))

    steps = steps_of(online, feed)
    filtered = [step for step, _ in steps]
    for lag in (0.05, 0.1, 0.3):
        found, _ = emitted(problem.model.state, steps, lag)
        for k, (_, belief, count) in enumerate(found):
            whole = smooth(filter, filtered[:count])[k]
            np.testing.assert_allclose(belief.mean, whole.mean, atol=1e-9)
            np.testing.assert_allclose(belief.covariance, whole.covariance, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize('failure', ['singular', 'nan'])
def test_a_step_that_cannot_be_inverted_ends_the_window(failure):
    space, steps = random_steps(4, 40)

    class Failing(SmoothableFilter):
        model = steps[0][1].model

        def predict(self, belief, u, dt):
            raise NotImplementedError

        def correct(self, belief, y, sensor):
            raise NotImplementedError

        def linearized(self, belief, u, dt):
            if failure == 'singular':
                raise np.linalg.LinAlgError('singular')
            found = steps[0][1].linearized(belief, u, dt)
            return found._replace(F=np.full_like(found.F, np.nan))

    steps[20] = steps[20][0], Failing()
    found, smoother = emitted(space, steps, 1.0)
    rest = list(smoother.finish())
    assert len(found) + len(rest) == 40
    assert all(np.isfinite(belief.mean).all() for _, belief, _ in found)
    assert found[19][2] == 21
    same(found[19][1], steps[19][0].belief)


def swapped_after_a_gap(order, policy):
    """Return an estimator with readings around a gap, in an order, and its smoothed beliefs."""
    _, system, sensor, prior = random_problem(8)
    filter = build_filter('kf', Plan(system, {'y': TimedSensor(sensor, 10.0)}, 10.0), {})
    online = OnlineEstimator(filter, {'y': sensor}, prior, np.zeros(2), policy)
    rng = np.random.default_rng(2)
    times = [k * 100_000_000 for k in [*range(20), *range(720, 760)]]
    rows = [(time, rng.normal(size=2)) for time in times]

    def feed(estimator):
        for k in order:
            estimator.add_reading('y', *rows[k])

    return online, emitted(system.state, steps_of(online, feed), 1.0)[0]


def test_a_late_reading_closes_the_gap_before_a_reading():
    order = [*range(20), 21, 20, *range(22, 60)]  # the first two after the silence are swapped
    policy = Policy(window=0.5)
    online, late = swapped_after_a_gap(order, policy)
    expected, in_order = swapped_after_a_gap(range(60), policy)
    assert online.restarts == expected.restarts == 1
    for (time, ours, _), (other, theirs, _) in zip(late, in_order, strict=True):
        assert time == other
        np.testing.assert_array_equal(ours.mean, theirs.mean)
        np.testing.assert_array_equal(ours.covariance, theirs.covariance)


@pytest.mark.slow
@pytest.mark.parametrize('seed', mostly_thorough(range(3), 1))
def test_a_heading_that_was_wrong_by_half_a_turn(seed):
    """Later readings together turn it by more than that."""
    scenario = kr.load('turn_rate')
    heading = scenario.model.state.names.index(scenario.model.state.angles[0])
    rng = np.random.default_rng(seed)
    mean = scenario.initial_belief.mean.copy()
    covariance = scenario.initial_belief.covariance.copy()
    covariance[heading, heading] = 1.5**2
    truth = mean.copy()
    mean[heading] += rng.uniform(2.7, 3.1)
    filter = build_filter(scenario.filter, scenario.plan, {})
    sensors = {key: source.sensor for key, source in scenario.enabled.items()}
    online = OnlineEstimator(
        filter, sensors, Gaussian(mean, covariance), np.zeros(0), Policy(window=0.0)
    )

    def feed(estimator):
        state = truth
        for k in range(60):
            for name, sensor in sensors.items():
                noise = np.sqrt(sensor.covariance.diagonal()) * rng.normal(size=sensor.output.size)
                estimator.add_reading(name, k * 100_000_000, sensor.measure(state) + noise)
            state = scenario.model.step(state, np.zeros(0), 0.1)

    steps = steps_of(online, feed)
    filtered = [step for step, _ in steps]
    found, _ = emitted(scenario.model.state, steps, 2.0)
    for k, (_, belief, count) in enumerate(found):
        same(belief, smooth(filter, filtered[:count])[k])


def test_a_state_that_is_known_exactly_is_smoothed_beside_the_others():
    model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0])
    sensor = kr.sensor([[1, 0]], 1.0)
    filter = kr.KalmanFilter(model)
    initial = Gaussian(np.zeros(2), np.diag([1.0, 0.0]))
    online = OnlineEstimator(filter, {'y': sensor}, initial, np.zeros(0), Policy(window=0.0))
    readings = np.random.default_rng(0).normal(size=20)

    def feed(estimator):
        for k, y in enumerate(readings):
            estimator.add_reading('y', k * 100_000_000, np.array([y]))

    steps = steps_of(online, feed)
    found, _ = emitted(model.state, steps, 0.5)
    for k, (_, belief, count) in enumerate(found):
        assert count == k + 6
        # a place that does not move: all readings count alike
        expected = readings[:count].sum() / (count + 1)
        np.testing.assert_allclose(belief.mean, [expected, 0.0], atol=1e-12)
        np.testing.assert_allclose(belief.covariance, np.diag([1 / (count + 1), 0]), atol=1e-12)
