# SPDX-License-Identifier: Apache-2.0
"""A linear combination of states has their unit, where they have one."""

import pytest

from kalman_ros.core import Space
from kalman_ros.sensors.linear import Linear

STATE = Space(('a', 'b', 'v'), ('m', 'm', 'm/s'))


@pytest.mark.parametrize(
    ('row', 'unit'),
    [
        ([0.0, 0.0, 1.0], 'm/s'),
        ([1.0, -1.0, 0.0], 'm'),
        ([1.0, 0.0, 1.0], ''),
        ([1000.0, 0.0, 0.0], ''),
        ([0.0, 0.0, 0.0], ''),
    ],
)
def test_the_unit_of_a_row(row, unit):
    assert Linear(STATE, [1.0], row).output.units == (unit,)
