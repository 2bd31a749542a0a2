# SPDX-License-Identifier: Apache-2.0
"""A batch of filters does what its members do one by one, on every shipped scenario."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from thorough import mostly_thorough

from kalman_ros.analysis.tuning.candidate import candidate_filter
from kalman_ros.arrays.scenarios import load
from kalman_ros.core import Gaussian, Model, Space
from kalman_ros.core.candidates import candidate_sensor
from kalman_ros.estimators import FILTERS, build_filter, filter_class
from kalman_ros.estimators.batch_estimator import BatchEstimator, for_many
from kalman_ros.estimators.consistency import chi_square_gate
from kalman_ros.estimators.filter import committed
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import shipped
from kalman_ros.simulation.simulated_plant import SimulatedPlant

SCENARIOS = sorted(path.stem for path in shipped.folder().glob('*.yaml'))
MEMBERS, STEPS = 3, 40


def served(scenario):
    kinds = {name: filter_class(name) for name in FILTERS}
    linear = scenario.plan.linear
    return [
        name for name, kind in kinds.items() if not kind.mixture and linear >= kind.needs_linear
    ]


#: The scenarios whose single estimators take the longest.
LONG = {'sound_tracker', 'robot_3d', 'inertial'}


def how_often(name, kind):
    """Return the marks of a case; the square root is that of the extended filter."""
    if kind == 'square_root' and name != 'cart_pole':
        return [pytest.mark.thorough]
    return [pytest.mark.slow] if name in LONG else []


CASES = [
    pytest.param(name, kind, marks=how_often(name, kind))
    for name in SCENARIOS
    for kind in served(load(name))
]


def recorded(scenario, seed, outliers):
    """Readings and inputs of an open loop, some readings lost and some far off."""
    rng = np.random.default_rng(seed)
    plant = SimulatedPlant(
        scenario.model, scenario.timed, scenario.rate, scenario.initial_state, seed
    )
    m = scenario.model.input.size
    steps = []
    for _ in range(STEPS):
        readings = {}
        for name, y in plant.readings().items():
            chance = rng.random()
            wrong = 40.0 * np.sqrt(scenario.sensors[name].sensor.covariance.diagonal())
            readings[name] = None if chance < 0.2 else y + wrong * (chance > 1.0 - outliers)
        u = scenario.model.equilibrium.input + 0.1 * rng.normal(size=m)
        steps.append((plant.time, readings, u))
        plant.step(u)
    return steps


def one_by_one(scenario, filter, policy, steps):
    estimator = OnlineEstimator(
        filter, sensors_of(scenario), scenario.initial_belief, scenario.model.equilibrium.input,
        policy,
    )  # fmt: skip
    beliefs = []
    for time, readings, u in steps:
        for name, y in readings.items():
            if y is not None:
                estimator.add_reading(name, time, y)
        beliefs.append(estimator.predicted(time))
        estimator.add_input(time, u)
    return beliefs, estimator


def sensors_of(scenario):
    return {name: source.sensor for name, source in scenario.enabled.items()}


def together(scenario, filter, policy, runs):
    estimator = BatchEstimator(
        filter, sensors_of(scenario), scenario.initial_belief, scenario.model.equilibrium.input,
        (len(runs),), policy,
    )  # fmt: skip
    beliefs = []
    for step in zip(*runs):
        time = step[0][0]
        estimator.advance(time)
        for name in step[0][1]:
            given = [readings[name] for _, readings, _ in step]
            present = np.array([y is not None for y in given])
            k = scenario.sensors[name].sensor.output.size
            y = np.array([np.zeros(k) if each is None else each for each in given])
            estimator.add_reading(name, y, present)
        beliefs.append(estimator.belief)
        estimator.set_input(np.array([u for _, _, u in step]))
    return beliefs, estimator


def scale(P):
    """The size of each entry that counts: of the deviations of its row and its column."""
    std = np.sqrt(P.diagonal())
    return np.outer(std, std) + 1e-30


@pytest.mark.parametrize(('name', 'kind'), CASES)
@pytest.mark.parametrize('gated', mostly_thorough([False, True], True))
def test_members_are_those_of_single_estimators(name, kind, gated):
    scenario = load(name)
    try:
        filter = build_filter(kind, scenario.plan)
    except ValueError as refused:
        pytest.skip(str(refused))
    gates = {
        each: chi_square_gate(0.99, source.sensor.output.size)
        for each, source in scenario.enabled.items()
    }
    policy = Policy(max_gap=0.0, gates=gates if gated else None, recover_after=4)
    # without a gate an outlier throws a linearised filter far off, where rounding is amplified
    runs = [recorded(scenario, seed, 0.1 * gated) for seed in range(MEMBERS)]
    batch, estimator = together(scenario, filter, policy, runs)
    for member, steps in enumerate(runs):
        single, alone = one_by_one(scenario, filter, policy, steps)
        for step, expected in enumerate(single):
            x, P = batch[step]
            P = P if P.ndim == 2 else P[member]
            std = np.sqrt(expected.covariance.diagonal())
            difference = scenario.model.state.subtract(x[member], expected.mean)
            assert np.all(np.abs(difference) <= 1e-10 * (std + np.abs(expected.mean))), step
            assert np.all(np.abs(P - expected.covariance) <= 1e-10 * scale(expected.covariance))
        for each, counts in alone.counts.items():
            accepted = sum(count for outcome, count in counts.items() if outcome.accepted)
            assert estimator.fused[each][member] == accepted
            assert estimator.rejected[each][member] == counts.total() - accepted


def test_a_covariance_that_all_share_stays_one_matrix():
    scenario = load('mass_spring_damper_2d')
    filter = for_many(build_filter('kf', scenario.plan))
    belief = Gaussian(np.zeros((5, 4)), np.broadcast_to(np.eye(4), (5, 4, 4)))
    shared = belief._replace(covariance=np.eye(4))
    sensor = scenario.sensors['position'].sensor
    y = np.random.default_rng(0).normal(size=(5, 2))
    for each in (belief, shared):
        predicted = filter.predict(each, np.zeros(2), 0.1)
        found = filter.correct(predicted, y, sensor)
        assert found.posterior.covariance.shape == each.covariance.shape
        assert found.nis.shape == (5,)


@pytest.mark.parametrize('bad', [np.nan, np.inf])
@pytest.mark.parametrize('of_one', [True, False])
def test_an_input_that_is_not_finite_leaves_that_of_its_member(bad, of_one):
    scenario = load('mass_spring_damper')
    filter = build_filter('kf', scenario.plan)
    estimator = BatchEstimator(
        filter, sensors_of(scenario), scenario.initial_belief, np.zeros(1), (3,)
    )
    estimator.advance(0)
    estimator.set_input(np.array([[1.0], [-2.0], [3.0]]))
    estimator.set_input(np.array([[4.0], [bad], [5.0]]) if of_one else np.full((3, 1), bad))
    found = estimator.advance(100_000_000).mean
    for mean, u in zip(found, [4.0, -2.0, 5.0] if of_one else [1.0, -2.0, 3.0]):
        expected = filter.predict(scenario.initial_belief, np.array([u]), 0.1).mean
        np.testing.assert_allclose(mean, expected, atol=1e-12)


def test_no_batch_of_gaussian_sums():
    scenario = load('bearing_tracker')
    with pytest.raises(ValueError, match='filter: expected one with a single Gaussian'):
        for_many(build_filter('gaussian_sum', scenario.plan))


class OneByOne(Model):
    """A model whose formulas are written for one vector and one mass."""

    state, input = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))

    def __init__(self, mass, noise):
        self._matrix = np.diag([1.0, mass])
        self._noise = noise

    def derivative(self, x, u):
        force = u[..., 0] - np.sin(x[..., 0])
        loads = np.stack((x[..., 1], force), axis=-1)
        return loads @ np.linalg.inv(self._matrix).T

    def noise_density(self, x):
        if x.ndim > 1:
            raise TypeError('one vector only')
        return np.diag([0.0, self._noise * (1.0 + x[0] ** 2)])


def test_a_model_of_single_vectors_is_called_for_each():
    filter = ExtendedKalmanFilter(OneByOne(2.0, 0.1))
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=(2, 4, 2)), np.ones((2, 4, 1))
    found = for_many(filter).predict(Gaussian(x, np.broadcast_to(np.eye(2), (2, 4, 2, 2))), u, 0.1)
    for at in np.ndindex(2, 4):
        expected = filter.predict(Gaussian(x[at], np.eye(2)), np.ones(1), 0.1)
        np.testing.assert_allclose(found.mean[at], expected.mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariance[at], expected.covariance, rtol=1e-10)


CANDIDATES = [
    ('cart_pole', 'ekf', 'model_parameters.cart_mass', 'joint_states.noise', 2),
    ('cart_pole', 'ukf', 'model_parameters.torque_noise', 'joint_states.noise', 2),
    ('mass_spring_damper_2d', 'kf', 'model_parameters.mass', 'position.noise', 2),
    ('turn_rate', 'ekf', 'model_parameters.turn_noise', 'lidar.noise', 2),
]


@pytest.mark.parametrize(('name', 'kind', 'parameter', 'noise', 'size'), CANDIDATES)
def test_candidates_are_their_single_filters_with_their_likelihoods(
    name, kind, parameter, noise, size
):
    values = [0.4, 0.5, 0.7]
    plain = load(name)
    scenarios = [load(name, {parameter: v, noise: [0.1 * v] * size}) for v in values]
    singles = [build_filter(kind, each.plan) for each in scenarios]
    filter = candidate_filter(singles)
    sensor_name = noise.partition('.')[0]
    sensors = [each.sensors[sensor_name].sensor for each in scenarios]
    sensor = candidate_sensor(sensors)
    steps = recorded(plain, 5, 0.0)[:12]
    n = plain.model.state.size
    belief = Gaussian(
        np.tile(plain.initial_belief.mean, (3, 1)),
        np.tile(plain.initial_belief.covariance, (3, 1, 1)),
    )
    alone, total, totals = [plain.initial_belief] * 3, np.zeros(3), np.zeros(3)
    for _, readings, u in steps:
        belief = filter.predict(belief, u, 0.02)
        alone = [f.predict(b, u, 0.02) for f, b in zip(singles, alone)]
        y = readings.get(sensor_name)
        if y is None:
            continue
        found = filter.correct(belief, y, sensor)
        belief, total = found.posterior, total + found.log_likelihood
        for p, each in enumerate(sensors):
            one = singles[p].correct(alone[p], y, each)
            S, k = one.innovation_covariance, y.size
            totals[p] += multivariate_normal.logpdf(one.innovation, np.zeros(k), S)
            alone[p] = one.posterior
    assert belief.mean.shape == (3, n)
    assert np.ptp(totals) > 0.1
    np.testing.assert_allclose(total, totals, rtol=1e-9)
    for p in range(3):
        np.testing.assert_allclose(belief.mean[p], alone[p].mean, rtol=1e-9, atol=1e-12)
        tolerance = 1e-10 * scale(alone[p].covariance)
        assert np.all(np.abs(belief.covariance[p] - alone[p].covariance) <= tolerance)


def test_candidates_whose_formulas_refuse_arrays_are_called_in_turn():
    singles = [ExtendedKalmanFilter(OneByOne(mass, 0.1 * mass)) for mass in (1.0, 2.0)]
    filter = candidate_filter(singles)
    rng = np.random.default_rng(4)
    x = rng.normal(size=(5, 2, 2))
    found = filter.predict(Gaussian(x, np.broadcast_to(np.eye(2), (5, 2, 2, 2))), np.ones(1), 0.1)
    for run, p in np.ndindex(5, 2):
        expected = singles[p].predict(Gaussian(x[run, p], np.eye(2)), np.ones(1), 0.1)
        np.testing.assert_allclose(found.mean[run, p], expected.mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariance[run, p], expected.covariance, rtol=1e-10)


def test_candidates_of_two_kinds_are_refused():
    plan = load('mass_spring_damper').plan
    with pytest.raises(ValueError, match='filter: expected several of one kind'):
        candidate_filter([build_filter('kf', plan), build_filter('ekf', plan)])


def test_a_member_whose_covariance_is_not_definite_is_repaired_as_alone():
    scenario = load('mass_spring_damper')
    filter = build_filter('kf', scenario.plan)
    sensors = {name: source.sensor for name, source in scenario.enabled.items()}
    batch = BatchEstimator(filter, sensors, scenario.initial_belief, np.zeros(1), (3,))
    P = np.tile(np.eye(2), (3, 1, 1))
    P[1] = [[1.0, 1.0], [1.0, 1.0 - 1e-14]]  # by rounding
    P[2] = -np.eye(2)
    mean = np.arange(6.0).reshape(3, 2)
    belief, failed = batch._committed(Gaussian(mean, P), np.array([True, True, True]))
    assert failed.tolist() == [False, False, True]
    repaired, count = committed(Gaussian(mean[1], P[1]))
    assert count == 1
    np.testing.assert_array_equal(belief.mean[1], repaired.mean)
    np.testing.assert_array_equal(belief.covariance[1], repaired.covariance)
    np.testing.assert_array_equal(belief.covariance[0], P[0])


def test_a_member_with_an_infinite_variance_begins_again():
    """Its first pivot is no number, but those behind it may be."""
    scenario = load('mass_spring_damper')
    n, start = scenario.model.state.size, scenario.initial_belief
    filter = build_filter('kf', scenario.plan)
    batch = BatchEstimator(filter, {}, start, scenario.model.equilibrium.input, (3,))
    P = np.tile(np.eye(n), (3, 1, 1))
    P[1, 0, 0] = np.inf
    with np.errstate(all='ignore'):
        _, failed = batch._committed(Gaussian(np.zeros((3, n)), P), np.ones(3, dtype=bool))
    assert failed.tolist() == [False, True, False]
