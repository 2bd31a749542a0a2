# SPDX-License-Identifier: Apache-2.0
"""The loop without ROS does what theory says, and theory notices when it does not."""

import numpy as np
import pytest

from kalman_ros.simulation import closed_loop, scenario, verdicts


@pytest.fixture(scope='module')
def system():
    return scenario.build({})


@pytest.fixture(scope='module')
def theory(system):
    return verdicts.theory(system)


@pytest.mark.parametrize('seed', range(3))
def test_a_right_loop_passes(system, theory, seed):
    run = closed_loop.run(system, theory.design.gain, 30.0, seed)
    failed = [check for check in verdicts.checks(system, theory, run) if not check.passed]
    assert not failed


@pytest.mark.parametrize(
    ('change', 'notices'),
    [
        ({'velocity.noise': [0.7, 0.7]}, 'NIS of velocity / 2'),
        ({'model_parameters.force_noise': 0.25}, 'RMS error of v_x'),
        ({'model_parameters.mass': 3.0}, 'regulator dynamics, chi2/32'),
    ],
)
def test_a_plant_other_than_believed_fails(system, theory, change, notices):
    real = scenario.build(change)
    # what the readings say of themselves is what the estimator was told
    run = closed_loop.run(real, theory.design.gain, 40.0, 0, believed=system)
    failed = {check.name for check in verdicts.checks(system, theory, run) if not check.passed}
    assert notices in failed


def test_a_gain_other_than_designed_fails(system, theory):
    run = closed_loop.run(system, 0.5 * theory.design.gain, 30.0, 0)
    failed = {check.name for check in verdicts.checks(system, theory, run) if not check.passed}
    assert 'regulator dynamics, chi2/32' in failed


def test_separation_the_error_does_not_know_the_regulator(system, theory):
    one = closed_loop.run(system, theory.design.gain, 5.0, 7)
    two = closed_loop.run(system, 3.0 * theory.design.gain, 5.0, 7)
    assert np.abs(one.input - two.input).max() > 0.1
    np.testing.assert_allclose(
        one.truth - one.estimate, two.truth - two.estimate, rtol=0.0, atol=1e-9
    )


def test_a_run_that_is_too_short_is_not_judged(system, theory):
    run = closed_loop.run(system, theory.design.gain, 2.0, 0)
    with pytest.raises(ValueError, match='duration: expected at least 7 s'):
        verdicts.checks(system, theory, run)
