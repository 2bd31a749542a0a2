# SPDX-License-Identifier: Apache-2.0
"""A run in real time has steps without an estimate; theory is compared with the others."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import first_fast

from kalman_ros import scenario
from kalman_ros.analysis import checks as verdicts
from kalman_ros.simulation import closed_loop


def without(run, missing):
    """Return a run without some of its steps."""
    kept = np.setdiff1d(np.arange(len(run.time)), missing)
    names = ('time', 'truth', 'estimate', 'covariance', 'input')
    return replace(run, **{name: getattr(run, name)[kept] for name in names})


@pytest.mark.slow
@pytest.mark.parametrize('missing', [[2, 3, 4, 5], [1, 40, 41, 200, 500, 501, 777, 1203]])
@pytest.mark.parametrize('seed', first_fast([1, 2, 3], 1))
def test_missing_steps_are_not_taken_for_wrong_ones(missing, seed):
    built = scenario.build({'model': 'mass_spring_damper'})
    theory = verdicts.theory(built)
    run = closed_loop.run(built, theory.feedback.gain, 14.0, seed)
    for found in (run, without(run, missing)):
        assert not [
            check.name for check in verdicts.checks(built, theory, found) if not check.passed
        ]


@pytest.mark.slow
def test_a_wrong_gain_is_still_seen_among_gaps():
    built = scenario.build({'model': 'mass_spring_damper'})
    theory = verdicts.theory(built)
    run = closed_loop.run(built, 0.2 * theory.feedback.gain, 14.0, 1)
    found = verdicts.checks(built, theory, without(run, [2, 3, 4, 5]))
    assert 'regulator dynamics' in ' '.join(check.name for check in found if not check.passed)
