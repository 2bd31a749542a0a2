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
