# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.observability import observability
from kalman_ros.core import DesignError
from kalman_ros.linear.structure import observed


def test_a_position_alone_observes_everything():
    found = observability(scenario.build({'sensors': ['position']}))
    assert found.seen == ('x', 'v_x', 'y', 'v_y')
    assert str(found) == 'the sensors observe x, v_x, y, v_y'


def test_an_axis_that_nobody_reads_is_named():
    values = {
        'sensors': ['position'],
        'position.measures': ['x'],
        'position.noise': [0.1],
        'position.fields': ['pose.pose.position.x'],
    }
    found = observability(scenario.build(values))
    assert found.unseen == ('y', 'v_y')
    with pytest.raises(DesignError, match='no sensor sees the growing mode at .*; the sensors ob'):
        observability(scenario.build({**values, 'model_parameters.stiffness_y': -1.0}))


def test_a_speed_does_not_tell_where_one_is_without_a_spring():
    A = np.array([[0.0, 1.0], [0.0, -0.3]])
    np.testing.assert_array_equal(observed(A, np.array([[0.0, 1.0]])), [False, True])
    np.testing.assert_array_equal(observed(A, np.array([[1.0, 0.0]])), [True, True])


def test_without_sensors_nothing_is_observed():
    assert not observed(np.eye(2), np.empty((0, 2))).any()
