# SPDX-License-Identifier: Apache-2.0
"""A model that does not rest without an input is pointed out, unless it waits for the first."""

import pytest

from kalman_ros.bags.replay import estimator_settings
from kalman_ros.pipeline.fusion import falls_while_idle


@pytest.mark.parametrize(
    ('name', 'given', 'said'),
    [
        ('inertial', {}, False),
        ('inertial', {'idle_input': 'zero'}, True),
        ('inertial', {'rest_until_input': False}, True),
        ('inertial', {'idle_input': 'zero', 'lockstep': True}, False),
        ('cart_pole', {'idle_input': 'zero', 'rest_until_input': False}, False),
        ('constant_velocity', {}, False),
    ],
)
def test_an_input_that_holds_a_weight_is_waited_for(name, given, said):
    found = estimator_settings(name, given)
    words = falls_while_idle(found.scenario, found.options)
    assert ('fz 9.807: with idle_input: equilibrium' in words) is said
    assert bool(words) is said
