# SPDX-License-Identifier: Apache-2.0
"""How the options of an estimator become its treatment of imperfect data."""

from dataclasses import replace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.estimators.policy import Policy
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.fusion import fusion, policy
from kalman_ros.scenario import build

PUSHED, ALONE = (build({'model': name}) for name in ('mass_spring_damper', 'turn_rate'))
PLAIN = EstimatorOptions()


def test_by_default_it_is_that_of_an_estimator_without_ros():
    assert policy(PUSHED, PLAIN) == Policy()


@pytest.mark.parametrize(
    ('option', 'value', 'expected'),
    [
        ('window', 2.5, {'window': 2.5}),
        ('gate_recover_after', 7, {'recover_after': 7}),
        ('restart_after', 8, {'restart_after': 8}),
        ('max_gap', 9.0, {'max_gap': 9.0}),
        ('future_tolerance', 0.5, {'future_tolerance': 0.5}),
        ('initialize', 'reading', {'from_reading': True}),
        ('rest_until_input', True, {'rest_until_input': True}),
    ],
)
def test_each_option_is_passed_on(option, value, expected):
    assert policy(PUSHED, replace(PLAIN, **{option: value})) == replace(Policy(), **expected)


@pytest.mark.parametrize(
    ('scenario', 'lockstep', 'rests'),
    [(PUSHED, False, True), (PUSHED, True, False), (ALONE, False, False)],
)
def test_only_in_real_time_does_a_body_rest_until_its_input(scenario, lockstep, rests):
    options = replace(PLAIN, rest_until_input=True, lockstep=lockstep)
    assert policy(scenario, options).rest_until_input is rests


@pytest.mark.parametrize('lockstep', [True, False])
def test_in_lockstep_an_input_keeps_its_stamps(lockstep):
    scenario = build({'input.stamp_offset': -0.1})
    options = replace(PLAIN, lockstep=lockstep)
    if not lockstep:
        assert fusion(scenario, options, {}).filter is not None
        return
    with pytest.raises(ValueError, match='^input.stamp_offset: expected 0 with lockstep'):
        fusion(scenario, options, {})


def test_another_start_is_refused():
    with pytest.raises(
        ValueError, match="^initialize: expected belief, reading or rest, got 'zero'"
    ):
        policy(PUSHED, replace(PLAIN, initialize='zero'))
