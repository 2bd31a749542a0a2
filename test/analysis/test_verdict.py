# SPDX-License-Identifier: Apache-2.0
"""Loops that are not linear are judged too, and a wrong filter is found out."""

from dataclasses import replace

import pytest
from scipy.stats import chi2, norm

from kalman_ros import scenario
from kalman_ros.analysis.checks import MISS
from kalman_ros.analysis.verdict import consistency, judge, nees_check
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


@pytest.mark.slow
def test_a_loop_with_an_estimate_at_few_steps_is_judged_by_consistency():
    """In real time an estimate follows a reading: at one step in five, of this scenario."""
    built = scenario.build({'model': 'linear'})
    run = closed_loop.run(built, regulator(built)[0].gain, 30.0, 0)
    every = slice(None, None, built.plan.period)
    sparse = replace(
        run, time=run.time[every], truth=run.truth[every], input=run.input[every],
        estimate=run.estimate[every], covariance=run.covariance[every],
    )  # fmt: skip
    judgement = judge(built, sparse)
    assert 'follows a reading' in judgement.basis
    assert all(check.passed for check in judgement.checks)
    assert 'cost J' in {check.name for check in judge(built, run).checks}


@pytest.mark.parametrize('name', ['level', 'diff_drive'])
def test_the_checks_together_fail_with_one_probability(name):
    """Bonferroni: of a check for each state and each sensor and one of all, each has its share."""
    built = scenario.build({'model': name})
    run = closed_loop.run(built, None, 0.5, 0)
    states, sensors, N = built.model.state.size, built.enabled, len(run.time)
    found = {check.name: check for check in consistency(built, run)}
    assert len(found) == states + len(sensors) + 1
    share = MISS / len(found)
    for state in built.model.state.names:
        check = found[f'largest error of {state} / std']
        assert check.high == pytest.approx(norm.isf(share / (2 * N)), rel=1e-9)
        assert check.low == 0.0
    for sensor, source in sensors.items():
        k = source.sensor.output.size
        degrees = k * len(run.innovations[sensor].nis)
        check = found[f'NIS of {sensor} / {k}']
        wanted = chi2.ppf([share / 2, 1 - share / 2], degrees) / degrees
        assert (check.low, check.high) == pytest.approx(wanted, rel=1e-6)
        assert check.expected == 1.0
    assert found[f'NEES / {states}'].expected == 1.0
    assert found[f'NEES / {states}'] == nees_check(built, run, share)
    assert found[f'NEES / {states}'] != nees_check(built, run, 2 * share)
