# SPDX-License-Identifier: Apache-2.0
"""The gradient of the likelihood along the delay of a sensor."""

from dataclasses import replace

import numpy as np
import pytest
from tuned_cases import COVERED, likelihood, recorded

from kalman_ros.analysis.tuning.fit import fit

ROBOT = replace(COVERED[2], seconds=8.0, starts={})


@pytest.mark.slow
@pytest.mark.parametrize(
    ('delay', 'true', 'at'),
    [
        # a speed that changes by noise alone: all that it shows of the delay is in covariances
        ('odometry.delay', 0.03, 0.011),
        ('imu.delay', 0.03, 0.052),
        # later than the recording begins, and earlier: the first reading is from before it then
        ('position.delay', 0.06, 0.048),
        ('position.delay', 0.06, 0.072),
    ],
)
def test_the_gradient_is_that_of_the_likelihood(delay, true, at):
    case = replace(ROBOT, fitted=[delay], errors={delay: true})
    found = likelihood(case, recorded(case, 5))
    z = np.array([found.parameters[0].scaled(at)])
    h = 1e-3
    above, below = (found.values([z + s * h])[0] for s in (1.0, -1.0))
    top = found.expand(z)
    deviation = top.information[0, 0] ** -0.5
    assert abs(top.gradient[0]) * deviation > 0.1
    assert top.gradient[0] == pytest.approx((above - below) / (2.0 * h), abs=0.03 / deviation)


@pytest.mark.thorough
@pytest.mark.slow
def test_the_delay_of_a_speed_is_found():
    case = replace(ROBOT, fitted=['odometry.delay'], errors={'odometry.delay': 0.03}, seconds=30.0)
    (found,) = fit(likelihood(case, recorded(case, 5))).parameters
    assert found.determined
    assert found.high - found.low < 0.02
    assert found.low < 0.03 < found.high
