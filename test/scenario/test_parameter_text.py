# SPDX-License-Identifier: Apache-2.0
"""Values as a node's command line accepts them."""

import numpy as np
import pytest

from kalman_ros.scenario.parameter_text import yaml_value


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        ([20, 0.5, 1], '[20.0, 0.5, 1.0]'),
        ([1, 2], '[1, 2]'),
        ([True, False], '[true, false]'),
        (np.array([1.0, np.inf]), '[1.0, .inf]'),
        ('', "''"),
        ('y', "'y'"),
    ],
)
def test_value_is_written_for_ros(value, text):
    assert yaml_value(value) == text
