# SPDX-License-Identifier: Apache-2.0
"""A bearing does not depend on the unit of length, nor does where a belief is divided."""

import numpy as np
import pytest

from kalman_ros.core import Gaussian, Space
from kalman_ros.sensors.bearing import Bearing

PLANE = Space(('x', 'y'), ('m', 'm'))


def prior(unit, P=((0.5, 0.1), (0.1, 0.3))):
    return Gaussian(unit * np.array([1.0, 0.5]), unit**2 * np.array(P))


@pytest.mark.parametrize('unit', [1e-3, 1e3])
def test_hypotheses_are_the_same_in_another_unit_of_length(unit):
    sensor, y = Bearing(PLANE, [0.01]), np.array([0.4])
    expected = sensor.hypotheses(prior(1.0), y, 6)
    found = sensor.hypotheses(prior(unit), y, 6)
    np.testing.assert_allclose(found.log_weights, expected.log_weights, rtol=1e-6)
    for part, reference in zip(found.parts, expected.parts):
        np.testing.assert_allclose(part.mean, unit * reference.mean, rtol=1e-6)
        np.testing.assert_allclose(
            part.covariance, unit**2 * reference.covariance, rtol=1e-6, atol=1e-9 * unit**2
        )


@pytest.mark.parametrize('P', [((0.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 9.0))])
def test_a_place_that_is_known_or_on_a_line_is_not_divided(P):
    assert Bearing(PLANE, [0.01]).hypotheses(prior(1.0, P), np.zeros(1), 6) is None
