# SPDX-License-Identifier: Apache-2.0
"""Noise and intervals of fits to few readings, where textbooks know the exact answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, t
from tuned_cases import COVERED, likelihood, recorded

import kalman_ros as kr
from kalman_ros.analysis.tuning import ascent
from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.intervals import reach
from kalman_ros.analysis.tuning.restricted import noise_power


def line(level=1.0, slope=0.5, r=1.0):
    """A straight line through readings, whose start and slope are parameters."""
    model = kr.discrete_model([[1.0, 1.0], [0.0, 1.0]], Q=np.zeros((2, 2)))
    return model, ([[1.0, 0.0]], [[r * r]]), ([level, slope], np.zeros((2, 2)))


@pytest.mark.parametrize('count', [8, 12, 40])
def test_a_line_through_few_readings_has_the_intervals_of_linear_regression(count):
    rng = np.random.default_rng(count)
    k = np.arange(count)
    y = 3.0 - 0.4 * k + rng.normal(0.0, 2.0, count)
    found = kr.tune(line, readings=y, linear=['level', 'slope'])
    X = np.column_stack((np.ones(count), k))
    beta, (rss,), _, _ = np.linalg.lstsq(X, y, rcond=None)
    s = np.sqrt(rss / (count - 2))  # unbiased; maximum likelihood divides by the count
    fitted = found.parameters
    # one step of scoring is exact up to the square of what it corrects
    few = count**-2.0
    assert fitted['r'].value == pytest.approx(s, rel=3.0 * few)
    half = t.ppf(0.975, count - 2) * s * np.sqrt(np.linalg.inv(X.T @ X).diagonal())
    for name, b, h in zip(('level', 'slope'), beta, half):
        assert fitted[name].value == pytest.approx(b, abs=0.01 * h)
        assert (fitted[name].high - fitted[name].low) / 2.0 == pytest.approx(h, rel=8.0 * few)


def test_noise_alone_is_that_of_maximum_likelihood():
    y = np.random.default_rng(1).normal(0.0, 2.0, 12)
    found = kr.tune(lambda r=1.0: line(0.0, 0.0, r), readings=y)
    assert found.parameters['r'].value == pytest.approx(np.sqrt(np.mean(y**2)), rel=1e-5)


@pytest.mark.parametrize('count', [4, 12, 100])
@pytest.mark.parametrize('power', [1.0, 2.0, -1.0])
def test_noise_alone_has_the_interval_of_a_variance(count, power):
    rng = np.random.default_rng(2)
    y = rng.normal(0.0, 2.0, count)
    found = kr.tune(lambda s=1.0: line(0.0, 0.0, s ** (power / 2.0)), readings=y).parameters['s']
    sums = np.sum(y**2) / chi2.ppf([0.975, 0.025], count)
    assert sorted((found.low, found.high)) == pytest.approx(
        sorted(sums ** (1.0 / power)), rel=1e-3
    )


def test_noise_from_less_than_two_readings_is_not_determined():
    found = kr.tune(lambda r=1.0: line(0.0, 0.0, r), readings=[0.3])
    assert found.undetermined == {'r': 'these data hardly depend on it'}


def test_intervals_of_noise_that_is_known_well_are_normal():
    for power in (1.0, 2.0):
        assert reach(1e-4, power) == pytest.approx(reach(1e-4), rel=1e-3)


def test_the_power_of_noise_is_that_of_its_variance():
    spring = likelihood(COVERED[0], recorded(replace(COVERED[0], seconds=1.0), 1))
    names = [each.name.rpartition('parameters.')[2] for each in spring.parameters]
    found = {name: noise_power(spring, spring.start, i) for i, name in enumerate(names)}
    expected = dict.fromkeys(names, 0.0) | {'force_noise': 1.0, 'position.noise': 2.0}
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
def test_points_expanded_in_one_pass_are_as_each_alone():
    case = replace(COVERED[1], seconds=2.0)
    found = likelihood(case, recorded(case, 4))
    points = [found.start, found.start + 0.05]
    for alone, other in zip(map(found.expand, points), found.expand_all(points)):
        assert other.value == pytest.approx(alone.value, rel=1e-12)
        # differences divide the rounding of the sum by their step
        assert other.gradient == pytest.approx(alone.gradient, rel=1e-6, abs=1e-4)
        assert other.information == pytest.approx(alone.information, rel=1e-6, abs=1e-4)


@pytest.mark.thorough
@pytest.mark.slow
def test_the_last_step_of_a_long_fit_leaves_nothing_to_gain(monkeypatch):
    case = replace(COVERED[0], seconds=60.0)
    case = replace(case, values={**case.values, 'position.rate': 25.0})
    data = recorded(case, 3)
    short = fit(likelihood(case, data)).parameters
    monkeypatch.setattr(ascent, '_NEARLY', 1e-6)
    long = fit(likelihood(case, data)).parameters
    for one, other in zip(short, long):
        std = (other.high - other.low) / 3.92
        assert abs(one.value - other.value) < 0.03 * std, one.name
        assert one.high - one.low == pytest.approx(other.high - other.low, rel=0.02)
