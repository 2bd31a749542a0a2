# SPDX-License-Identifier: Apache-2.0
"""The parts of a fit: its scale, its intervals, the order of events, and earlier readings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, norm
from scipy.stats import t as student

from kalman_ros.analysis.tuning.earlier import Earlier, corrected
from kalman_ros.analysis.tuning.free_parameter import STEP, FreeParameter
from kalman_ros.analysis.tuning.held_out import SensorJudgement, _judge_sensor
from kalman_ros.analysis.tuning.identifiability import determination
from kalman_ros.analysis.tuning.intervals import reach
from kalman_ros.analysis.tuning.observations import Observations, Readings
from kalman_ros.analysis.tuning.profiles import profiles
from kalman_ros.core import Gaussian, LinearSystem, Space
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.sensors.linear import Linear

SPACES = Space(('x', 'v'), ('m', 'm/s')), Space(('f',), ('N',))


def test_a_positive_parameter_is_fitted_by_its_logarithm():
    free = FreeParameter('r', 2.0, 0.5, 8.0, positive=True, prior=(2.0, 0.5))
    assert free.scaled(4.0) == pytest.approx(np.log(4.0))
    assert free.scaled(0.0) == free.scaled(-1.0) == -np.inf
    assert free.value(np.log(4.0)) == pytest.approx(4.0)
    assert (free.value(-9.0), free.value(9e9)) == (0.5, 8.0)
    low, high = np.log(0.5) + 2.0 * STEP, np.log(8.0) - 2.0 * STEP
    assert free.limits == pytest.approx((low, high), abs=1e-12)
    assert free.prior_scaled == pytest.approx((np.log(2.0), 0.25))


def test_any_other_parameter_is_fitted_in_units_of_its_scale():
    free = FreeParameter('b', 1.0, -4.0, 6.0, scale=2.0, prior=(1.0, 0.5))
    assert (free.scaled(3.0), free.value(1.5)) == (1.5, 3.0)
    assert (free.value(-9.0), free.value(9.0)) == (-4.0, 6.0)
    assert free.limits == pytest.approx((-2.0 + 2.0 * STEP, 3.0 - 2.0 * STEP), abs=1e-12)
    assert free.prior_scaled == (0.5, 0.25)
    plain = FreeParameter('b', 0.0)
    assert plain.limits == (-np.inf, np.inf) and plain.prior_scaled is None
    assert plain.value(0.25) == 0.25


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        ({'start': np.inf}, 'a finite start'),
        ({'start': 0.0, 'positive': True}, 'a start above 0'),
        ({'start': 1.0, 'low': 1.0, 'high': 1.0}, 'bounds LOW < HIGH'),
        ({'start': 0.9, 'low': 1.0}, 'the bounds 1 to inf exclude the start, 0.9'),
        ({'start': 1.1, 'high': 1.0}, 'the bounds -inf to 1 exclude the start, 1.1'),
        ({'start': 1.0, 'prior': (np.nan, 1.0)}, 'a prior'),
        ({'start': 1.0, 'prior': (1.0, 0.0)}, 'a prior'),
        ({'start': 1.0, 'prior': (1.0, np.inf)}, 'a prior'),
        ({'start': 1.0, 'prior': (0.0, 1.0), 'positive': True}, 'a prior'),
    ],
)
def test_what_cannot_be_fitted_is_named(options, reason):
    with pytest.raises(ValueError, match=f'^r: .*{reason}'):
        FreeParameter('r', **options)


@pytest.mark.parametrize(
    'options',
    [
        {'start': 1.0, 'low': 1.0},
        {'start': 1.0, 'high': 1.0},
        {'start': 0.0, 'prior': (0.0, 1.0)},
        {'start': -1.0},
    ],
)
def test_a_start_may_be_at_a_bound_and_a_prior_about_zero(options):
    assert FreeParameter('r', **options).start == options['start']


def test_intervals_have_the_width_of_their_distribution():
    assert reach(2.0) == pytest.approx((2.0 * norm.ppf(0.975),) * 2, rel=1e-6)
    assert reach(2.0, freedom=3.0) == pytest.approx((2.0 * student.ppf(0.975, 3),) * 2)
    for power in (2.0, -2.0):
        f = 2.0 / (2.0 * 0.3) ** 2
        below, above = np.log(chi2.ppf(0.975, f) / f) / 2.0, -np.log(chi2.ppf(0.025, f) / f) / 2.0
        expected = (below, above) if power > 0.0 else (above, below)
        assert reach(0.3, power) == pytest.approx(expected)
    # of less than a reading, any noise is likely
    for std in (50.0, 90.0, 1e3):
        assert reach(std, 2.0) == reach(std, -2.0) == (np.inf, np.inf)
        hardly = determined([[std**-2]], power=np.array([2.0]))
        assert hardly.reasons[0].startswith('these data ')


def determined(information, positive=True, power=None):
    p = len(information)
    free = [FreeParameter(name, 1.0, positive=positive) for name in 'abc'[:p]]
    return determination(free, np.array(information), np.zeros(p), power)


@pytest.mark.parametrize(('positive', 'widest'), [(True, np.log(10.0)), (False, 6.0)])
def test_a_parameter_is_determined_up_to_a_width(positive, widest):
    std = widest / norm.ppf(0.975)
    for times, reason in (
        (0.99, ''),
        (1.01, 'these data hardly depend on it'),
        (49.0 * norm.ppf(0.975), 'these data hardly depend on it'),
        (51.0 * norm.ppf(0.975), 'these data do not depend on it'),
    ):
        found = determined([[(times * std) ** -2]], positive)
        assert found.reasons == (reason,)
        assert found.seen.tolist() == [reason != 'these data do not depend on it']
        assert found.rank == int(found.seen[0])
        assert (found.std[0] == pytest.approx(times * std)) is not bool(reason)
        variance = 0.0 if reason else (times * std) ** 2
        assert found.covariance == pytest.approx(np.array([[variance]]))


def test_the_width_of_noise_is_that_of_its_own_distribution():
    """Of one that is known to a factor, the upper end is farther away than the lower one."""
    std = 0.9 * np.log(10.0) / norm.ppf(0.975)
    assert determined([[std**-2]]).reasons == ('',)
    noise = determined([[std**-2]], power=np.array([2.0]))
    assert noise.reasons == ('these data hardly depend on it',)


def test_two_parameters_that_show_only_together_are_tied():
    found = determined([[100.0, 100.0, 0.0], [100.0, 100.0, 0.0], [0.0, 0.0, 100.0]])
    assert found.reasons == (
        'only a combination with b shows', 'only a combination with a shows', '',
    )  # fmt: skip
    assert found.rank == 2
    assert np.isnan(found.std[:2]).all() and found.std[2] == pytest.approx(0.1)
    assert found.covariance[2, 2] == pytest.approx(0.01)
    assert not found.covariance[:2].any() and not found.covariance[:, :2].any()


@pytest.mark.parametrize(('share', 'tied'), [(0.9e-6, True), (1.1e-6, False)])
def test_a_direction_without_a_millionth_of_the_information_is_not_seen(share, tied):
    r = 1.0 - share  # the eigenvalues are 1 - r and 1 + r
    found = determined([[1e9, 1e9 * r], [1e9 * r, 1e9]])
    assert (found.rank == 1) is tied
    assert found.reasons[0].startswith('only a combination' if tied else '')


@pytest.mark.parametrize(('times', 'named'), [(3.1, True), (2.9, False)])
def test_a_wide_interval_is_due_to_another_parameter_if_alone_it_is_a_third(times, named):
    r = -np.sqrt(1.0 - times**-2)  # std with the other unknown, over that with it known
    scale = 0.25
    found = determined([[scale, r * scale, 0.0], [r * scale, scale, 0.0], [0.0, 0.0, 100.0]])
    words = f'it can hardly be distinguished from b (correlation {-r:+.3f})'
    assert found.reasons[0] == (words if named else 'these data hardly depend on it')


def test_correlations_are_those_of_the_errors():
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = determined(np.linalg.inv(covariance))
    np.testing.assert_allclose(found.std, [0.2, 0.3])
    np.testing.assert_allclose(found.correlation, [[1.0, 1 / 6], [1 / 6, 1.0]])
    np.testing.assert_allclose(found.covariance, covariance)


def stamps(*seconds):
    return np.array([round(t * 1e9) for t in seconds], dtype=np.int64)


NAN = np.nan
OBSERVATIONS = Observations(
    {
        'a': Readings(stamps(2.0, 1.0, 3.0), np.array([[1.0, NAN], [NAN, NAN], [3.0, 4.0]])),
        'b': Readings(stamps(2.0, 4.0), np.array([[5.0], [6.0]])),
        'none': Readings(stamps(), np.empty((0, 1))),
    },
    stamps(0.5, 2.0, 4.0, 9.0), np.arange(4.0)[:, np.newaxis],
)  # fmt: skip


def events(delays, until=None):
    return [(e.time / 1e9, e.order, e.row) for e in OBSERVATIONS.events(delays, until)]


def test_events_are_in_order_and_a_reading_comes_before_an_input_of_its_time():
    assert events({}) == [(0.5, 3, 0), (2.0, 0, 0), (2.0, 1, 0), (2.0, 3, 1), (3.0, 0, 2),
                          (4.0, 1, 1)]  # fmt: skip
    assert events({'b': 0.25}) == [(0.5, 3, 0), (1.75, 1, 0), (2.0, 0, 0), (2.0, 3, 1),
                                   (3.0, 0, 2), (3.75, 1, 1)]  # fmt: skip
    assert events({}, until=3 * 10**9)[-1] == (3.0, 0, 2)
    assert events({}, until=3 * 10**9 - 1)[-1] == (2.0, 1, 0)  # an input acts on no reading
    assert events({}, until=0) == []


def test_the_readings_are_counted_by_their_numbers():
    assert OBSERVATIONS.count == 5
    assert OBSERVATIONS.span == (10**9, 4 * 10**9)
    assert OBSERVATIONS.first == 5 * 10**8
    assert OBSERVATIONS.until(0.0) == 10**9
    assert OBSERVATIONS.until(0.5) == 2 * 10**9
    assert OBSERVATIONS.until(1.0) == 4 * 10**9


BODY = LinearSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [2.0]], np.diag([0.0, 3.0]), *SPACES)


def test_an_earlier_reading_is_that_of_the_state_before():
    sensor = Earlier(Linear(SPACES[0], [1.0, 1.0], [1.0, 0.0, 0.0, 1.0]), BODY)
    x, earlier = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([0.1, 0.0])
    sensor.set(earlier, np.array([0.5]))
    np.testing.assert_allclose(sensor.measure(x), [[1.0 - 0.1 * 2.0, 2.0 - 0.1 * 1.0], [3.0, 4.0]])
    between = sensor.noise_between(x, 1.0)
    np.testing.assert_allclose(between[:, 1, 1], 3.0 * earlier, rtol=1e-6)
    np.testing.assert_allclose(sensor.noise_between(x, 0.04)[0], 0.4 * between[0], rtol=1e-9)
    other = sensor.with_covariance(4.0 * np.eye(2))
    other.set(np.array([0.2, 0.2]), np.array([0.5]))
    np.testing.assert_allclose(sensor.measure(x), other.measure(x))


def test_noise_that_was_added_later_remains_after_an_earlier_reading():
    sensor, y = Linear(SPACES[0], [1.0], [1.0, 0.0]), np.array([[0.7]])
    P, noise = np.array([[[2.0, 0.3], [0.3, 1.0]]]), np.array([np.diag([0.5, 0.2])])
    x = np.array([[0.1, 0.2]])
    filter = KalmanFilter(BODY)
    found = corrected(filter, Gaussian(x, P), y, sensor, noise)
    before = filter.correct(Gaussian(x, P - noise), y, sensor)
    np.testing.assert_allclose(found.posterior.mean, before.posterior.mean)
    np.testing.assert_allclose(found.posterior.covariance, before.posterior.covariance + noise)
    np.testing.assert_allclose(found.nis, before.nis)


def test_a_profile_of_a_normal_distribution_is_its_parabola():
    free = [FreeParameter('a', 1.0, scale=2.0, unit='m'), FreeParameter('b', 1.0)]
    covariance = np.array([[0.04, 0.03], [0.03, 0.09]])
    information = np.linalg.inv(covariance)
    found = determination(free, information, np.array([0.5, 1.0]))
    top = SimpleNamespace(z=np.array([0.5, 1.0]), value=-7.0)

    def values(points):
        off = np.array(points) - top.z
        skew = off[:, 0] ** 3  # without which both sides are the same
        return top.value - 0.5 * np.einsum('ki,ij,kj->k', off, information, off) + skew

    def fitted(*flags):
        seen = replace(found, std=np.where(flags, found.std, np.nan))
        parts = {'top': top, 'correlation': found.correlation, 'parameters': free}
        return SimpleNamespace(determination=seen, **parts)

    likelihood = SimpleNamespace(parameters=free, values=values)
    offsets = np.array([-3.0, -2.25, -1.5, -0.75, 0.0, 0.75, 1.5, 2.25, 3.0])
    first, second = profiles(likelihood, fitted(True, True))
    assert (first.name, first.unit, second.name) == ('a', 'm', 'b')
    np.testing.assert_allclose(first.value, 2.0 * (0.5 + 0.2 * offsets))
    np.testing.assert_allclose(second.value, 1.0 + 0.3 * offsets)
    for profile, along in ((first, 0.2), (second, 0.03 / 0.3)):  # the change of a by a deviation
        expected = -0.5 * offsets**2 + (along * offsets) ** 3
        np.testing.assert_allclose(profile.drop, expected, atol=1e-9)
        np.testing.assert_allclose(profile.expected, -0.5 * offsets**2)
    (only,) = profiles(likelihood, fitted(False, True))
    # the other one, of which nothing is known, stays where it is
    np.testing.assert_allclose(only.drop, -0.5 * (0.3 * offsets) ** 2 * information[1, 1])
    assert profiles(likelihood, fitted(False, False)) == []


def test_a_sensor_is_judged_by_all_its_readings_and_by_neighbours_that_are_whole():
    rng = np.random.default_rng(0)
    whole, partial = rng.normal(size=(30, 2)), rng.normal(size=(5, 1))
    parts = [
        (np.arange(10.0, 40.0), whole, 2, np.sum(whole**2, axis=1) / 2.0),
        (np.arange(5.0), partial, 1, np.sum(partial**2, axis=1)),
    ]
    found = _judge_sensor(parts, 0.01)
    assert (np.diff(found.time) > 0.0).all() and found.time[0] == 0.0
    np.testing.assert_allclose(found.squares[:5], partial[:, 0] ** 2)
    assert found.nis == pytest.approx((np.sum(whole**2) + np.sum(partial**2)) / 65)
    assert found.nis_bounds == pytest.approx(chi_square_bounds(1.0, 2.0 / 65, 0.01))
    assert found.whiteness == pytest.approx(np.sum(whole[1:] * whole[:-1]) / np.sum(whole**2))
    assert found.white_bound == pytest.approx(norm.isf(0.005) / np.sqrt(60))
    assert found.rejected == 3
    none = _judge_sensor([(np.zeros(0), np.zeros((0, 1)), 4, np.zeros(0))], 0.01)
    assert (none.nis, none.whiteness, none.rejected) == (0.0, 0.0, 4)
    assert not none.judged


@pytest.mark.parametrize(
    ('count', 'nis', 'whiteness', 'judged', 'consistent'),
    [
        (20, 1.0, 0.0, True, True),
        (19, 1.0, 0.0, False, True),
        (20, 0.5, 0.2, True, True),
        (20, 2.0, -0.2, True, True),
        (20, 0.49, 0.0, True, False),
        (20, 2.01, 0.0, True, False),
        (20, 1.0, 0.21, True, False),
        (20, 1.0, -0.21, True, False),
    ],
)
def test_a_sensor_is_consistent_within_its_bounds(count, nis, whiteness, judged, consistent):
    found = SensorJudgement(np.zeros(count), np.zeros(count), nis, (0.5, 2.0), whiteness, 0.2, 0)
    assert (found.judged, found.consistent) == (judged, consistent)
