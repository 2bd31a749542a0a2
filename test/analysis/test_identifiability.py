# SPDX-License-Identifier: Apache-2.0
"""A parameter at its bound has no interval; one that is only near it has."""

import numpy as np
import pytest

from kalman_ros.analysis.tuning.free_parameter import FreeParameter
from kalman_ros.analysis.tuning.identifiability import determination


@pytest.mark.parametrize(
    ('value', 'reason'),
    [
        (0.5, 'it is at its bound, 0.5'),
        (0.501, ''),
        (1.0, ''),
        (1.9, ''),
        (1.999, ''),
        (2.0, 'it is at its bound, 2'),
    ],
)
@pytest.mark.parametrize('positive', [True, False])
def test_a_parameter_is_at_a_bound_where_it_is_and_not_before(value, reason, positive):
    parameter = FreeParameter('mass', 1.0, 0.5, 2.0, positive=positive)
    low, high = parameter.limits
    z = np.clip([parameter.scaled(value)], low, high)
    found = determination([parameter], np.array([[1e4]]), z)
    assert found.reasons == (reason,)
    assert np.isnan(found.std[0]) == bool(reason)


@pytest.mark.parametrize(
    ('bounds', 'std', 'reason'),
    [
        ((-1.0, 1.0), 0.0064, ''),  # of a delay by ten milliseconds, of which a second is open
        ((-1.0, 1.0), 0.049, ''),
        ((-1.0, 1.0), 0.053, 'these data hardly depend on it'),
        ((-np.inf, np.inf), 0.0064, 'these data hardly depend on it'),
        ((-np.inf, np.inf), 0.0059, ''),
        ((-0.02, 0.02), 0.0059, ''),
    ],
)
def test_an_interval_that_leaves_little_of_the_bounds_determines_a_parameter(bounds, std, reason):
    delay = FreeParameter('imu.delay', 0.0, *bounds, scale=0.002)
    found = determination([delay], np.array([[(0.002 / std) ** 2]]), np.zeros(1))
    assert found.reasons == (reason,)
