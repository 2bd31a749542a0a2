# SPDX-License-Identifier: Apache-2.0
"""Whole runs of shipped scenarios pass the checks of their own demo.

``python test/survey.py`` counts the seeds of each that do not.
"""

import pytest
from survey import failures
from thorough import thorough


# Seeds at which one linearisation for each range lost the target as it passed close by.
@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'seed'),
    [
        thorough('bearing_tracker', 11),
        thorough('bearing_tracker', 23),
        thorough('bearing_tracker', 26),
        thorough('sound_tracker', 2),
        thorough('sound_tracker', 6),
        ('two_bearings', 2),
    ],
)
def test_a_target_that_passes_close_by_is_not_lost(name, seed):
    assert failures(name, seed) == []


@pytest.mark.slow
def test_the_survey_finds_a_wrong_belief():
    assert failures('level', 0) == []
    assert failures('level', 0, initial_std=[1e-3]) != []
