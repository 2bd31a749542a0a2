# SPDX-License-Identifier: Apache-2.0
"""The loop without ROS agrees with theory, and theory notices when it does not."""

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.analysis import checks as verdicts
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop


@pytest.fixture(scope='module')
def system():
    return scenario.build({})


@pytest.fixture(scope='module')
def theory(system):
    return verdicts.theory(system)


@pytest.mark.slow
@pytest.mark.parametrize('seed', mostly_thorough(range(3), 0))
def test_a_right_loop_passes(system, theory, seed):
    run = closed_loop.run(system, theory.feedback.gain, 30.0, seed)
    failed = [check for check in verdicts.checks(system, theory, run) if not check.passed]
    assert not failed


@pytest.mark.slow
@pytest.mark.parametrize(
    ('change', 'notices'),
    [
        ({'velocity.noise': [0.7, 0.7]}, 'NIS of velocity / 2'),
        ({'model_parameters.force_noise': 0.25}, 'RMS error of v_x'),
        ({'model_parameters.mass': 3.0}, 'regulator dynamics, misfit^2'),
    ],
)
def test_a_plant_other_than_believed_fails(system, theory, change, notices):
    real = scenario.build(change)
    # the covariances of the readings are those of the estimator
    run = closed_loop.run(real, theory.feedback.gain, 40.0, 0, believed=system)
    failed = {check.name for check in verdicts.checks(system, theory, run) if not check.passed}
    assert notices in failed


@pytest.mark.slow
def test_a_gain_other_than_designed_fails(system, theory):
    run = closed_loop.run(system, 0.5 * theory.feedback.gain, 30.0, 0)
    failed = {check.name for check in verdicts.checks(system, theory, run) if not check.passed}
    assert 'regulator dynamics, misfit^2' in failed


def test_separation_the_error_does_not_know_the_regulator(system, theory):
    one = closed_loop.run(system, theory.feedback.gain, 5.0, 7)
    two = closed_loop.run(system, 3.0 * theory.feedback.gain, 5.0, 7)
    assert np.abs(one.input - two.input).max() > 0.1
    np.testing.assert_allclose(
        one.truth - one.estimate, two.truth - two.estimate, rtol=0.0, atol=1e-9
    )


def test_a_run_that_is_too_short_is_not_judged(system, theory):
    run = closed_loop.run(system, theory.feedback.gain, 2.0, 0)
    with pytest.raises(ValueError, match='run: expected 6.9 s or more to judge it'):
        verdicts.checks(system, theory, run)


@pytest.mark.slow
def test_it_regulates_about_the_equilibrium():
    # the submersible rests with thrusters on, and five newtons are far from none
    built = scenario.build({'model': 'submersible', 'initial_state': [0.0] * 6})
    u = built.model.equilibrium.input
    run = closed_loop.run(built, regulator(built)[0].gain, 3.0, 0)
    np.testing.assert_allclose(u, [0.0, -2.5, -2.5])
    assert np.abs(run.truth[:, 1]).max() < 0.1
    held = closed_loop.run(built, None, 3.0, 0)
    np.testing.assert_array_equal(held.input, np.tile(u, (len(held.time), 1)))


def test_a_command_is_fed_forward(system):
    run = closed_loop.run(system, None, 1.0, 0, command=lambda time: np.array([time, -1.0]))
    np.testing.assert_allclose(run.input[:, 0], run.time)
    np.testing.assert_array_equal(run.input[:, 1], -1.0)


def test_what_does_not_arrive_is_not_fused(system):
    run = closed_loop.run(
        system, None, 2.0, 0, arrives=lambda name, time: name != 'position' or time < 0.5
    )
    assert run.readings['position'].time.max() < 0.5
    assert run.readings['velocity'].time.max() == 2.0
    assert np.all(np.diff(run.covariance[60:, 0, 0]) > 0.0)


def test_the_filter_is_the_one_that_suits_the_scenario():
    assert scenario.build({}).filter == 'kf'
    assert scenario.build({'model': 'cart_pole'}).filter == 'ekf'
    assert scenario.build({'model': 'cart_pole', 'filter': 'ukf'}).filter == 'ukf'
    with pytest.raises(ValueError, match='filter: kf needs a linear model, got CartPole'):
        closed_loop.run(scenario.build({'model': 'cart_pole'}), None, 1.0, 0, filter='kf')
    with pytest.raises(ValueError, match="kf needs linear sensors, and the Radar 'radar' is not"):
        closed_loop.run(scenario.build({'model': 'constant_velocity'}), None, 1.0, 0, filter='kf')
