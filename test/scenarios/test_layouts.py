# SPDX-License-Identifier: Apache-2.0
"""Messages that are read and written in place carry the same numbers as those that are not."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness import Run


@pytest.mark.thorough
@pytest.mark.parametrize('name', ['mass_spring_damper_2d', 'cart_pole', 'diff_drive'])
def test_layouts_change_no_number(name):
    runs = []
    for learn in (True, False):
        with Run(name, {'learn_layouts': learn}, seed=3) as run:
            run.advance(1.0)
            runs.append(run.trajectory())
    learnt, decoded = runs
    assert len(learnt.time) == 1.0 * run.scenario.rate + 1
    for what in ('time', 'truth', 'estimate', 'covariance', 'input'):
        np.testing.assert_array_equal(getattr(learnt, what), getattr(decoded, what))
    for sensor in run.scenario.enabled:
        np.testing.assert_array_equal(
            learnt.readings[sensor].values, decoded.readings[sensor].values
        )
        np.testing.assert_array_equal(
            learnt.innovations[sensor].nis, decoded.innovations[sensor].nis
        )
