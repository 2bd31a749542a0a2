# SPDX-License-Identifier: Apache-2.0
"""The readings by which a fit is judged: which they are, when, and how they scatter."""

from dataclasses import replace

import numpy as np
from tuned_cases import COVERED, likelihood, recorded

from kalman_ros.analysis.tuning.held_out import judge

CASE = replace(COVERED[0], seconds=8.0, starts={})


def test_the_readings_of_a_judgement_are_dated_in_seconds_from_the_first():
    found = likelihood(CASE, recorded(CASE, 2))
    stamp = found.observations.readings['position'].stamp
    values = {each.name: each.start for each in found.parameters}
    late = int(stamp[len(stamp) // 2])
    whole, rest = judge(found, values, None, late)
    seconds = (stamp - stamp[0]) * 1e-9
    assert seconds[-1] > 7.0
    np.testing.assert_allclose(whole.sensors['position'].time, seconds)
    np.testing.assert_allclose(rest.sensors['position'].time, seconds[stamp > late])
    np.testing.assert_array_equal(
        rest.sensors['position'].squares, whole.sensors['position'].squares[stamp > late]
    )
