# SPDX-License-Identifier: Apache-2.0
"""A failed check names its likely causes."""

import pytest

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.suspects import suspects


def check(name, measured, low=0.9, high=1.1):
    return Check(name, '', 1.0, measured, low, high, low <= measured <= high)


@pytest.mark.parametrize(
    ('name', 'measured', 'says'),
    [
        ('NIS of velocity / 2', 3.0, 'velocity.noise that is too small'),
        ('NIS of velocity / 2', 0.3, 'velocity.noise that is too large'),
        ('NEES / 4', 3.0, 'Errors are larger than the covariance says'),
        ('RMS error of x', 3.0, 'The estimate of x is worse than predicted'),
        ('largest error of theta / std', 9.0, 'The estimate of theta is biased'),
        ('regulator dynamics, misfit^2', 3.0, 'suspect a parameter of the model'),
        ('estimator dynamics, misfit^2', 3.0, 'suspect the noise parameters'),
        ('RMS of v_x', 3.0, 'v_x moves more than predicted'),
    ],
)
def test_a_check_that_fails_has_a_suspect(name, measured, says):
    (found,) = suspects([check('cost J', 1.0), check(name, measured)])
    assert says in found


def test_a_sensor_without_a_reading_is_no_sensor_with_little_noise():
    (found,) = suspects([check('NIS of velocity / 2', float('nan'))])
    assert found == 'No reading of velocity was fused: suspect its topic or its gate.'


def test_a_check_that_holds_has_none():
    assert suspects([check('NIS of velocity / 2', 1.0), check('NEES / 4', 1.05)]) == []


def test_one_cause_is_said_once():
    assert len(suspects([check('NEES / 4', 3.0), check('NEES / 4', 4.0)])) == 1
