# SPDX-License-Identifier: Apache-2.0
"""A sensor measures at its rate, from the first step on."""

from itertools import pairwise

import pytest

from kalman_ros.core import is_due, ratio


@pytest.mark.parametrize(
    ('rate', 'loop'), [(100.0, 100.0), (20.0, 100.0), (7.0, 100.0), (0.1, 1.0)]
)
def test_readings_in_whole_seconds_are_as_many_as_the_rate_says(rate, loop):
    share = ratio(rate, loop)
    seconds = 50
    due = [step for step in range(round(seconds * loop) + 1) if is_due(step, share)]
    assert len(due) == round(seconds * rate) + 1
    assert due[0] == 0
    gaps = {later - earlier for earlier, later in pairwise(due)}
    assert gaps <= {int(loop / rate), -int(-loop // rate)}
