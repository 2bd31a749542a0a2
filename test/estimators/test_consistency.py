# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.stats import chi2

from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators.consistency import (
    ChiSquareWindow,
    chi_square_bounds,
    chi_square_gate,
    nees,
    normalised,
    verdict,
)
from kalman_ros.estimators.error_statistics import Comparison
from kalman_ros.sensors.linear import Linear


@pytest.mark.parametrize('degrees', [1, 3, 40])
def test_bounds_of_independent_values_are_those_of_chi_square(degrees):
    low, high = chi_square_bounds(1.0, 2.0 / degrees, 0.01)
    expected = chi2.ppf([0.005, 0.995], degrees) / degrees
    np.testing.assert_allclose([low, high], expected, rtol=1e-9)


def test_a_gate_passes_with_its_probability():
    np.testing.assert_allclose(chi_square_gate(0.99, 2), chi2.ppf(0.99, 2))


def test_nees_of_many():
    P = np.array([[2.0, 0.5], [0.5, 1.0]])
    errors = np.random.default_rng(0).multivariate_normal([0, 0], P, 20_000)
    values = nees(errors, np.tile(P, (20_000, 1, 1)))
    np.testing.assert_allclose(values[0], errors[0] @ np.linalg.inv(P) @ errors[0])
    assert abs(values.mean() - 2.0) < 4.5 * 2.0 / np.sqrt(20_000)


def test_a_window_judges_what_it_holds():
    window = ChiSquareWindow(degrees=2, length=200)
    assert window.inside()
    rng = np.random.default_rng(0)
    for value in rng.chisquare(2, 200):
        window.add(value)
    assert window.inside()
    for value in 1.6 * rng.chisquare(2, 200):
        window.add(value)
    assert window.count == 200
    assert not window.inside()


def test_what_is_said_to_be_certain_is_right_or_infinitely_wrong():
    P = np.array([[2.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 1.0]])
    rest = P[np.ix_([0, 2], [0, 2])]
    error = np.array([1.0, 0.0, -2.0])
    assert nees(error, P) == pytest.approx(error[[0, 2]] @ np.linalg.solve(rest, error[[0, 2]]))
    both = nees(np.array([error, [1.0, 1e-9, -2.0]]), np.tile(P, (2, 1, 1)))
    assert np.isfinite(both[0])
    assert both[1] == np.inf
    assert nees(np.zeros(2), np.zeros((2, 2))) == 0.0


@pytest.mark.parametrize(('degrees', 'count'), [(1, 1), (2, 10), (6, 400)])
def test_the_bounds_of_an_average_are_those_of_chi_square(degrees, count):
    window = ChiSquareWindow(degrees)
    for _ in range(count):
        window.add(float(degrees))
    exact = chi2.ppf([0.005, 0.995], degrees * count) / (degrees * count)
    np.testing.assert_allclose(window.bounds(0.01), exact, rtol=1e-9)


@pytest.mark.parametrize('factor', [0.01, 0.0, -1.0])
def test_a_covariance_that_is_too_small_or_none_at_all_is_called_too_sure(factor):
    rng = np.random.default_rng(0)
    found = Comparison(Space(('a', 'b'), ('', '')), {}, np.eye(2), 100)
    for time in range(100):
        found.truth(time, np.zeros(2))
        found.estimate(time, Gaussian(rng.normal(size=2), factor * np.eye(2)))
    found.settle()
    assert found.nees.mean > 10.0 and not found.nees.inside()


def test_pairs_are_compared_in_any_number_at_once():
    """Also without a call of `settle`, so that no more of them are kept than a few hundred."""
    space, rng, found = Space(('a', 'b'), ('', 'rad'), ('b',)), np.random.default_rng(1), []
    sensor = Linear(space, [1.0, 1.0], [1.0, 0.0, 0.0, 1.0])
    x, mean, y, u = (rng.normal(scale=3.0, size=(1200, size)) for size in (2, 2, 2, 1))
    P, weight = np.array([[2.0, 0.3], [0.3, 1.0]]), np.diag([1.0, 2.0, 3.0])
    for each in (False, True):
        comparison = Comparison(space, {'y': sensor}, weight, 2000)
        for time in range(1200):
            comparison.reading('y', time, y[time])
            comparison.truth(time, x[time])
            comparison.estimate(time, Gaussian(mean[time], P))
            comparison.input(time, u[time])
            assert sum(map(len, comparison._pairs.values())) < 1500
            if each:
                comparison.settle()
        comparison.settle()
        roots = comparison.error.root, comparison.raw['y'].root, comparison.fused['y'].root
        found.append([*np.hstack(roots), comparison.nees.mean, comparison.cost])
        assert comparison.steps == comparison.error.count == comparison.nees.count == 1200
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    z = np.hstack((x, u))
    np.testing.assert_allclose(found[0][-1], np.sum(z**2 * weight.diagonal()), rtol=1e-12)
    errors = space.subtract(x, mean)
    np.testing.assert_allclose(found[0][:2], np.sqrt(np.mean(errors**2, axis=0)), rtol=1e-12)


@pytest.mark.parametrize('error', [[0.0, 1.0, -2.0], [0.5, 1.0, -2.0], [0.0, np.nan, 1.0]])
def test_errors_in_certain_coordinates_count_alike_with_and_without_a_root(error):
    """A certain coordinate without error counts nothing, with one all; NaN is not taken for 0."""
    P = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.5], [0.0, 0.5, 1.0]])
    z = normalised(np.array(error), P)
    np.testing.assert_allclose(z @ z, nees(np.array(error), P))
    rest = np.array(error)[1:] @ np.linalg.solve(P[1:, 1:], np.array(error)[1:])
    np.testing.assert_allclose(z @ z, np.inf if error[0] else rest)
    several = normalised(np.array([error, error]), np.array([P, P]))
    np.testing.assert_array_equal(several, [z, z])


def test_a_verdict_names_what_has_no_values():
    """Nothing is called consistent whose NIS is NaN."""
    full, empty = ChiSquareWindow(1), ChiSquareWindow(1)
    full.add(1.0)
    assert verdict({'NIS of a': full}) == 'consistent'
    assert verdict({'NIS of a': full, 'NIS of b': empty}) == 'consistent; no NIS of b to judge yet'
    assert verdict({'NIS of a': empty}) == 'no NIS of a to judge yet'
    assert verdict({}) == 'nothing to judge'
