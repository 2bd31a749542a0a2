# SPDX-License-Identifier: Apache-2.0
"""The square-root filter keeps what a covariance cannot hold."""

import copy
import pickle

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import Gaussian, LinearSystem, Space
from kalman_ros.core import Sensor as Base
from kalman_ros.estimators.filters.kf import KalmanFilter
from kalman_ros.estimators.filters.square_root import FactoredGaussian, SquareRootFilter
from kalman_ros.estimators.online import OnlineEstimator

PLANE = Space(('a', 'b'), ('', ''))
REST = LinearSystem(np.zeros((2, 2)), np.zeros((2, 0)), np.zeros((2, 2)), PLANE, Space((), ()))


class Reading(Base):
    """A linear reading of one number."""

    linear, output = True, Space(('y',), ('',))

    def __init__(self, H, R):
        self._H, self.covariance = np.array([H], dtype=float), np.array([[R]])

    def measure(self, x):
        return x @ self._H.T

    def jacobian(self, x):
        return self._H


def after(filter, wide):
    """The sum and then the difference of two numbers, measured well; they were ``wide``."""
    belief = Gaussian(np.zeros(2), wide**2 * np.eye(2))
    for H in ([1.0, 1.0], [1.0, -1.0]):
        belief = filter.correct(belief, np.ones(1), Reading(H, 1e-6)).posterior
    return belief


@pytest.mark.parametrize('wide', [1e2, 1e5, 1e8])
def test_a_small_variance_beside_a_large_one_keeps_its_digits(wide):
    """Of two readings with variance r remain r / 2 of each number, and nothing between them.

    Between the readings the variance of the sum is lost in that of the difference, for doubles
    hold 16 digits: what Kaminski, Bryson and Schmidt (IEEE Trans. Automatic Control 16(6), 1971)
    show with such an example.
    """
    P = after(SquareRootFilter(REST), wide).covariance
    np.testing.assert_allclose(P, 0.5e-6 * np.eye(2), rtol=1e-6, atol=1e-9)


def test_the_covariance_form_loses_them():
    try:
        P = after(KalmanFilter(REST), 1e8).covariance
    except np.linalg.LinAlgError:
        return
    assert np.abs(P - 0.5e-6 * np.eye(2)).max() > 1e-7


def test_the_factor_goes_on_from_step_to_step():
    filter = SquareRootFilter(kr.continuous_model([[0.0, 1.0], [0.0, 0.0]], W=[0.0, 0.1]))
    belief = filter.predict(Gaussian(np.ones(2), np.eye(2)), np.zeros(0), 0.1)
    found = filter.correct(belief, np.ones(1), Reading([1.0, 0.0], 0.1)).posterior
    for each in (belief, found):
        assert isinstance(each, FactoredGaussian)
        np.testing.assert_allclose(each.factor @ each.factor.T, each.covariance, rtol=1e-14)
        assert not np.triu(each.factor, 1).any()
    wider = found._replace(covariance=4.0 * found.covariance)
    assert type(wider) is Gaussian
    for again in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        np.testing.assert_array_equal(again.factor, found.factor)
        np.testing.assert_array_equal(again.covariance, found.covariance)
    online = OnlineEstimator(filter, {'y': Reading([1.0, 0.0], 0.1)}, found, np.zeros(0))
    for k in range(5):
        online.add_reading('y', k * 100_000_000, np.zeros(1))
    assert isinstance(online.belief, FactoredGaussian)


@pytest.mark.parametrize('wide', [1e5, 1e6, 1e7, 1e8])
def test_the_online_estimator_repairs_no_factor(wide):
    found = kr.filter(
        kr.discrete_model(np.eye(2), np.zeros((2, 1)), np.zeros((2, 2))),
        {'difference': ([[1.0, -1.0]], 1e-6), 'first': ([[1.0, 0.0]], 1e-6)},
        {'difference': [0.0, 1.0], 'first': [2.0]},
        {'difference': [0.0, 0.0], 'first': [0.0]},
        initial=([0, 0], [wide**2] * 2),
        filter='square_root',
    )
    # the variances of the first number and of a mean of two differences
    np.testing.assert_allclose(found.std[-1], [1e-3, np.sqrt(1.5e-6)], rtol=1e-4)
