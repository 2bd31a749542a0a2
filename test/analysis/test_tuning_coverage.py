# SPDX-License-Identifier: Apache-2.0
"""What fits say of simulated recordings whose parameters are known; `tuning_survey` takes 200."""

import pytest
from thorough import mostly_thorough
from tuned_cases import COVERED, HIDDEN
from tuning_survey import complaints, fitted

pytestmark = pytest.mark.slow


@pytest.mark.parametrize('case', mostly_thorough(HIDDEN, HIDDEN[0]), ids=lambda case: case.name)
def test_parameters_that_cannot_be_determined_are_called_so(case):
    estimates, _ = fitted(case.name, 1)
    assert {each.name for each in estimates if each.reason} == {*case.hidden}


@pytest.mark.thorough
@pytest.mark.parametrize('case', [COVERED[0], COVERED[2]], ids=['spring', 'robot'])
def test_most_intervals_cover_and_delays_are_found(case):
    estimates, converged = fitted(case.name, 1)
    assert converged and not any(each.reason for each in estimates)
    # of nine intervals of 95 %, six or fewer cover with a probability of 1 %
    assert sum(each.covers for each in estimates) >= len(estimates) - 2
    delays = [each for each in estimates if each.name.endswith('.delay')]
    for each in delays:
        assert not list(complaints(case.name, [each]))
