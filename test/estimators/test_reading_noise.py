# SPDX-License-Identifier: Apache-2.0
"""Readings that surprise count less, and noise that changes is followed."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2
from simulated_recordings import readings
from thorough import mostly_thorough, thorough

from kalman_ros.arrays.scenarios import load
from kalman_ros.estimators.batch_estimator import BatchEstimator
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.estimators.policy import Policy
from kalman_ros.estimators.reading_noise import MOST, Adaptation, adaptation, softening
from kalman_ros.estimators.timeline import Arrival
from kalman_ros.scenario.estimation import estimation

#: Satellite positions with noise of 3 m, beside a slow IMU.
SLOW = {'rate': 20.0, 'imu.rate': 20.0}
GNSS = {**SLOW, 'gnss.noise': [3.0, 3.0]}
POSITION = {
    'kind': 'states', 'measures': ['x', 'y'], 'noise': [3.0, 3.0], 'rate': 5.0,
    'type': 'geometry_msgs/PoseWithCovarianceStamped',
    'fields': ['pose.pose.position.x', 'pose.pose.position.y'],
}  # fmt: skip
#: The same with three receivers more.
OTHERS = ('gnss_b', 'gnss_c', 'gnss_d')
FOUR = {
    **GNSS,
    'sensors': ['gnss', 'imu', *OTHERS],
    **{f'{name}.{key}': value for name in OTHERS for key, value in POSITION.items()},
    **{f'{name}.topic': name for name in OTHERS},
}


def altered(arrival, **changes):
    """Return an arrival with other numbers."""
    same = {name: getattr(arrival, name) for name in ('source', 'time', 'values', 'covariance')}
    return Arrival(**{**same, **changes})


def arrivals(scenario, seconds, seed=0):
    """Return readings of a scenario without input, in the order of their stamps."""
    time = np.arange(0.0, seconds, 1.0 / scenario.rate)
    inputs = np.zeros((len(time), scenario.model.input.size))
    states, times, values = readings(scenario, time, inputs, seed)
    found = [
        Arrival(name, round(t * 1e9), y)
        for name in scenario.enabled
        for t, y in zip(times[name], values[name])
    ]
    return sorted(found, key=lambda each: each.time), states


def online(scenario, **policy):
    zero = np.zeros(scenario.model.input.size)
    found = estimation(scenario, Policy(**policy)).online(zero)
    found.add_input(0, zero)
    return found


def passed(scenario, given):
    """Return the estimator after all readings, with the means by stamp and each result."""
    found, means, results = online(scenario), {}, []
    for each in given:
        results.append(found.add([each])[0])
        means[each.time] = found.belief.mean
    return found, means, results


def moved(given, name, chosen, by):
    """Return the readings with some of a sensor moved: of those with ``chosen`` seconds."""
    return [
        altered(each, values=each.values + by)
        if each.source == name and chosen(each.time * 1e-9)
        else each
        for each in given
    ]


def distance(before, after, since):
    """Return how far the positions of two passes part at most, in metres."""
    return max(np.hypot(*(after[t] - before[t])[:2]) for t in after if t >= since * 1e9)


def correction(S, z):
    nis = np.einsum('...i,...ij,...j->...', z, np.linalg.inv(S), z)
    return SimpleNamespace(innovation=z, innovation_covariance=S, nis=nis)


@pytest.mark.parametrize('k', [1, 2, 3])
def test_a_softened_reading_lies_at_the_limit(k):
    rng = np.random.default_rng(k)
    A, B = rng.standard_normal((2, 7, k, k))
    S_state, R = A @ A.swapaxes(1, 2), B @ B.swapaxes(1, 2) + 0.1 * np.eye(k)
    z, limit = 6.0 * rng.standard_normal((7, k)) / np.arange(1, 8)[:, np.newaxis], 2.0
    found = softening(correction(S_state + R, z), R, limit)

    def excess(factor, i):
        return z[i] @ np.linalg.solve(S_state[i] + factor * R[i], z[i]) - limit

    within = [excess(1.0, i) <= 0.0 for i in range(7)]
    assert 0 < sum(within) < 7
    for i in range(7):
        expected = 1.0 if within[i] else brentq(excess, 1.0, 1e9, (i,), xtol=1e-13, rtol=1e-14)
        assert found[i] == pytest.approx(expected, rel=1e-9)
        one = correction((S_state + R)[i], z[i])
        assert softening(one, R[i], limit) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(('share', 'told'), [(1.0, 1.0), (0.6, 0.36), (0.01, 0.25)])
def test_the_factor_moves_by_the_slope_over_the_information(share, told):
    """For one number: R is a share of S, and tells the square of the share, a quarter at least."""
    R, z, scale = np.array([[2.0]]), np.array([3.0]), 1.7
    S = R / share
    nis = float(z @ z) / float(S[0, 0])
    for limit, part in ((2.0 * nis, 1.0), (nis / 2.0, 1.0), (2.0 * nis, 0.8)):
        counts = min(nis, limit) / part
        expected = scale * max(1.0 + share * (counts - 1.0) / (20.0 * told), 0.5)
        assert Adaptation(limit, part).after(scale, correction(S, z), R) == pytest.approx(expected)


def test_the_factor_has_bounds():
    R, found = np.array([[1.0]]), adaptation(1, np.inf, np.inf)
    assert found.after(90.0, correction(R, np.array([100.0])), R) == MOST
    assert found.after(0.0101, correction(R, np.array([0.0])), R) == 1.0 / MOST
    # one glitch is one reading of twenty
    assert found.after(1.0, correction(R, np.array([1e6])), R) < 2.0


@pytest.mark.parametrize('k', [1, 2, 6])
@pytest.mark.parametrize(
    ('soft', 'gate'), [(1.0, 1.0), (0.9, 1.0), (0.5, 1.0), (1.0, 0.9), (0.7, 0.95), (0.5, 0.5)]
)
def test_the_share_is_the_mean_of_what_counts(k, soft, gate):
    """Of a million readings with the declared noise."""
    found = adaptation(k, chi2.ppf(soft, k), chi2.ppf(gate, k))
    nis = np.random.default_rng(k).chisquare(k, 1_000_000)
    counts = np.minimum(nis[nis <= chi2.ppf(gate, k)], found.limit)
    assert found.share == pytest.approx(counts.mean() / k, rel=4e-3)
    assert found.limit == pytest.approx(chi2.ppf(min(soft, gate, 0.9999), k))


@pytest.mark.slow
@pytest.mark.parametrize(
    'options',
    [thorough({'gate': 0.9}), {'soft_gate': 0.5}, {'gate': 0.95, 'soft_gate': 0.7}, thorough({})],
)
def test_whatever_the_gates_the_noise_stays_that_of_the_readings(options):
    changes = {f'lidar.{key}': value for key, value in {**options, 'adapt': True}.items()}
    scenario = load('constant_velocity', {**changes, 'rate': 10.0, 'radar.rate': 5.0})
    found, noise = online(scenario), []
    for each in arrivals(scenario, 150.0)[0]:
        found.add([each])
        noise.append(found.noise['lidar'])
    assert 0.8 < np.mean(noise[200:]) < 1.25
    assert found.counts['lidar'][Outcome.REJECTED] < 0.2 * 1500


@pytest.mark.slow
@pytest.mark.parametrize('adapt', [False, True])
@pytest.mark.parametrize('wrong', mostly_thorough([50.0, 1000.0], 1000.0))
def test_a_wrong_start_is_left_within_a_minute(wrong, adapt):
    """A receiver that is alone is believed: a run of readings that surprise is a wrong belief."""
    changes = {**SLOW, 'initial_estimate': [wrong, 0.0, 0.4, 9.0, 0.0, 0.0, 0.0, 0.0]}
    scenario = load('gnss_imu', {**changes, 'gnss.soft_gate': 0.95, 'gnss.adapt': adapt})
    given, states = arrivals(scenario, 60.0)
    found, means, _ = passed(scenario, given)
    errors = [
        np.hypot(*(mean - states[round(time * 1e-9 * scenario.rate)])[:2])
        for time, mean in means.items()
    ]
    assert max(errors[len(errors) // 3 :]) < 100.0
    assert errors[-1] < 10.0
    assert found.counts['gnss'][Outcome.RECOVERED] > 0


def test_a_gap_and_an_option_that_is_off_forget_the_noise():
    changes = {**SLOW, 'gnss.adapt': True}
    scenario = load('gnss_imu', changes)
    given, _ = arrivals(scenario, 10.0)
    given = moved(given, 'gnss', lambda t: t > 2.0 and round(5 * t) % 2, [4.0, 0.0])
    found = passed(scenario, given)[0]
    assert found.noise['gnss'] > 3.0
    late = altered(given[-1], source='imu', values=np.zeros(2), time=300 * 10**9)
    found.add([late])
    assert found.noise['gnss'] == 1.0
    found = passed(scenario, given)[0]
    built, plain = (estimation(load('gnss_imu', each)) for each in (changes, SLOW))
    found.configure(plain.filter, plain.sensors, plain.policy)
    gnss = next(each for each in reversed(given) if each.source == 'gnss')
    found.add([altered(gnss, time=gnss.time + 10**9)])
    found.configure(built.filter, built.sensors, built.policy)
    assert found.noise['gnss'] == 1.0


@pytest.mark.parametrize('spike', [1e10, 1e60, 1e76, 1e100, 1e150])
def test_a_spike_of_any_size_leaves_the_belief_finite(spike):
    scenario = load('gnss_imu', {**SLOW, 'gnss.soft_gate': 0.95, 'gnss.adapt': True})
    given, _ = arrivals(scenario, 5.0)
    given = moved(given, 'gnss', lambda t: 3.0 < t < 3.3, [spike, 0.0])
    found = passed(scenario, given)[0]
    assert np.isfinite(found.belief.mean).all()
    assert found.counts['gnss'][Outcome.FUSED] > 20


@pytest.mark.parametrize('kind', ['ekf', 'ukf', 'square_root'])
def test_late_readings_find_the_noise_of_their_time(kind):
    changes = {
        **SLOW,
        'filter': kind,
        'gnss.adapt': True,
        'gnss.soft_gate': 0.9,
        'gnss.gate': 0.9999,
    }
    scenario = load('gnss_imu', changes)
    given, _ = arrivals(scenario, 6.0)
    given = moved(given, 'gnss', lambda t: 2.0 < t < 4.0, [2.0, -1.0])
    in_order = passed(scenario, given)[0]
    late = online(scenario, window=10.0)
    rng = np.random.default_rng(1)
    order = np.argsort([each.time + rng.integers(0, 2_000_000_000) for each in given])
    late.add([given[i] for i in order])
    assert late.noise == in_order.noise
    assert late.noise['gnss'] > 1.3
    np.testing.assert_array_equal(late.belief.mean, in_order.belief.mean)
    np.testing.assert_array_equal(late.belief.covariance, in_order.belief.covariance)
    assert late.counts == in_order.counts
    assert in_order.counts['gnss'][Outcome.WEAKENED] > 3
    assert sum(in_order.counts['gnss'].values()) == 30


@pytest.mark.slow
@pytest.mark.parametrize('others', [False, True])
def test_a_batch_weighs_each_member_as_alone(others):
    """Alone the receiver is believed after five readings; beside three others it is not."""
    weights = {'adapt': True, 'soft_gate': 0.9, 'gate': 0.999}
    names = ('gnss', *OTHERS) if others else ('gnss',)
    changes = {f'{name}.{key}': value for name in names for key, value in weights.items()}
    scenario = load('gnss_imu', {**(FOUR if others else SLOW), **changes, 'imu.adapt': True})
    alone = [arrivals(scenario, 6.0, seed)[0] for seed in range(3)]
    near, far = ([9.0, 0.0], [80.0, 0.0]) if others else ([1.5, 1.5], [80.0, 0.0])
    alone[1] = moved(alone[1], 'gnss', lambda t: t > 1.0, near)
    alone[2] = moved(alone[2], 'gnss', lambda t: t > 1.0, far)
    built = estimation(scenario, Policy(max_gap=0.0, recover_after=5))
    batch = BatchEstimator(
        built.filter, built.sensors, built.initial, np.zeros(0), (3,), built.policy
    )
    for each in zip(*alone):
        batch.advance(each[0].time)
        batch.add_reading(each[0].source, np.array([one.values for one in each]))
    outcomes = set()
    for index, given in enumerate(alone):
        single = online(scenario, max_gap=0.0, recover_after=5)
        for each in given:
            single.add([each])
        np.testing.assert_allclose(batch.belief.mean[index], single.belief.mean, rtol=1e-8)
        counts = single.counts['gnss']
        fused = sum(n for outcome, n in counts.items() if outcome.accepted)
        assert batch.fused['gnss'][index] == fused
        assert batch.rejected['gnss'][index] == sum(counts.values()) - fused
        outcomes |= set(counts)
    expected = {Outcome.OUTVOTED} if others else {Outcome.RECOVERED}
    assert expected | {Outcome.WEAKENED} <= outcomes


@pytest.mark.slow
def test_a_spike_moves_the_estimate_by_less_than_a_metre():
    """15 m off, at a standard deviation of 3 m."""
    scenario = load('gnss_imu', {**GNSS, 'gnss.soft_gate': 0.95})
    given, _ = arrivals(scenario, 30.0)
    spiked = moved(given, 'gnss', lambda t: t > 15.0 and round(5.0 * t) % 25 == 0, [15.0, 0.0])
    plain = load('gnss_imu', GNSS)
    parts = [
        distance(passed(each, given)[1], passed(each, spiked)[1], 15.0)
        for each in (plain, scenario)
    ]
    assert parts[1] < 0.8 < 1.2 < parts[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ('options', 'low', 'high'),
    [
        thorough({}, 4.5, 5.2),
        thorough({'soft_gate': 0.95}, 1.5, 2.6),
        ({'soft_gate': 0.95, 'adapt': True}, 0.9, 1.5),
        ({'soft_gate': 0.95, 'gate': 0.9999}, 0.3, 1.3),
    ],
)
def test_a_cluster_of_outliers_does_not_capture_the_estimate(options, low, high):
    """50 readings in a row of one receiver, 15 m off, against three others, all of 3 m."""
    changes = {f'{name}.{key}': v for name in ('gnss', *OTHERS) for key, v in options.items()}
    scenario = load('gnss_imu', {**FOUR, **changes})
    given, _ = arrivals(scenario, 35.0)
    cluster = moved(given, 'gnss', lambda t: 20.0 <= t < 30.0, [15.0, 0.0])
    found = distance(passed(scenario, given)[1], passed(scenario, cluster)[1], 15.0)
    assert low < found < high


def mean_nis(scenario, name, given, since):
    """Return the mean NIS of readings 60 to 120 after a change, over its expectation."""
    found, _, results = passed(scenario, given)
    chosen = [
        result[1].nis
        for each, result in zip(given, results)
        if each.source == name and each.time >= since * 1e9
    ]
    return found, np.mean(chosen[60:120]) / given[0].values.size


@pytest.mark.slow
@pytest.mark.parametrize('factor', [10.0, 0.1])
@pytest.mark.parametrize(
    ('gate', 'runs', 'least'), [thorough(1.0, 4, 3), (0.999, 4, 3), thorough(0.999, 100, 93)]
)
def test_noise_that_changes_tenfold_is_followed_within_sixty_readings(factor, gate, runs, least):
    options = {'rate': 10.0, 'noise': [0.5, 0.5]}
    changes = SLOW | {f'gnss.{key}': value for key, value in options.items()}
    scenario = load('gnss_imu', {**changes, 'gnss.adapt': True, 'gnss.gate': gate})
    inside, stds = [], []
    for seed in range(runs):
        given, states = arrivals(scenario, 20.0, seed)
        for i, each in enumerate(given):
            if each.source == 'gnss' and each.time > 8_000_000_000:
                true = states[round(each.time * 1e-9 * scenario.rate)][:2]
                error = (each.values - true) * np.sqrt(factor)
                given[i] = altered(each, values=true + error)
        found, ratio = mean_nis(scenario, 'gnss', given, 8.0)
        low, high = chi_square_bounds(1.0, 2.0 / (2 * 60), 0.05)
        inside.append(low <= ratio <= high)
        assert found.noise['gnss'] == pytest.approx(factor, rel=0.7)
        stds.append(found.belief.std[0])
    assert sum(inside) >= least
    plain = load('gnss_imu', changes)
    before = passed(plain, given)[0].belief.std[0]
    assert all((std > before) == (factor > 1.0) for std in stds)


@pytest.mark.thorough
def test_on_clean_data_errors_grow_by_two_percent_at_most():
    """All sensors adapt; 24 runs, the same readings."""
    plain = load('gnss_imu')
    scenario = load('gnss_imu', {'gnss.adapt': True, 'imu.adapt': True})
    squares = {'plain': [], 'adapts': []}
    for seed in range(24):
        given, states = arrivals(plain, 25.0, seed)
        for name, each in (('plain', plain), ('adapts', scenario)):
            means = passed(each, given)[1]
            times = [t for t in means if t >= 5_000_000_000]
            errors = plain.model.state.subtract(
                np.array([means[t] for t in times]), states[[round(t * 1e-7) for t in times]]
            )
            squares[name].append(np.mean(errors**2, axis=0))
    plain, adapts = (np.sqrt(np.mean(each, axis=0)) for each in squares.values())
    assert np.all(adapts / plain < 1.02)


@pytest.mark.parametrize('kind', ['steady_state', 'luenberger'])
@pytest.mark.parametrize('option', [{'soft_gate': 0.9}, {'adapt': True}])
def test_a_fixed_gain_has_no_noise_to_change(kind, option):
    ((key, value),) = option.items()
    scenario = load('mass_spring_damper', {'filter': kind, f'position.{key}': value})
    with pytest.raises(ValueError, match=rf'^position\.{key}: the gain of {kind} is fixed'):
        estimation(scenario)


@pytest.mark.parametrize('kind', ['ukf', 'gaussian_sum'])
def test_other_filters_weigh_readings_too(kind):
    scenario = load('two_bearings', {'filter': kind, 'west.soft_gate': 0.9, 'west.adapt': True})
    given, _ = arrivals(scenario, 10.0)
    given = moved(given, 'west', lambda t: t > 5.0, 0.5)
    found, _, results = passed(scenario, given)
    assert found.noise['west'] > 1.2
    assert found.counts['west'][Outcome.WEAKENED] > 5
    assert all(c is None or np.isfinite(c.nis) for _, c in results)
