# SPDX-License-Identifier: Apache-2.0
"""Loops that are not linear are judged too, and a wrong filter is found out."""

import pytest

from kalman_ros import scenario
from kalman_ros.analysis.verdict import judge
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop


def failed(built, run):
    return {check.name for check in judge(built, run).checks if not check.passed}


@pytest.mark.slow
@pytest.mark.parametrize('name', ['cart_pole', 'submersible'])
def test_a_right_loop_passes(name):
    built = scenario.build({'model': name})
    assert not failed(built, closed_loop.run(built, regulator(built)[0].gain, 5.0, 0))


@pytest.mark.slow
@pytest.mark.parametrize('name', ['level', 'turn_rate', 'constant_velocity', 'diff_drive'])
def test_what_nobody_steers_passes(name):
    built = scenario.build({'model': name})
    assert not failed(built, closed_loop.run(built, None, 5.0, 0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ('change', 'notices'),
    [
        ({'joint_states.noise': [0.005, 0.015]}, 'NIS of joint_states / 2'),
        ({'joint_states.noise': [0.005, 0.007]}, 'NIS of joint_states / 2'),
        ({'model_parameters.gravity': 15.0}, 'largest error of omega / std'),
        ({'initial_state': [0.0, 0.0, -0.3, 3.0]}, 'largest error of omega / std'),
    ],
)
def test_a_plant_other_than_believed_fails(change, notices):
    believed = scenario.build({'model': 'cart_pole'})
    real = scenario.build({'model': 'cart_pole', **change})
    run = closed_loop.run(real, regulator(believed)[0].gain, 5.0, 0, believed=believed)
    assert notices in failed(believed, run)


def test_a_linear_loop_is_judged_by_theory():
    built = scenario.build({})
    run = closed_loop.run(built, regulator(built)[0].gain, 10.0, 0)
    judgement = judge(built, run)
    assert judgement.settling_time > 1.0
    assert 'cost J' in {check.name for check in judgement.checks}
