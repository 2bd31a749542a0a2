# SPDX-License-Identifier: Apache-2.0
"""How far a plant in lockstep may continue."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.live.pace import Pace


def test_a_plant_that_has_not_begun_is_not_paused():
    pace = Pace(lockstep=True, speed=2.0)
    targets = [pace.target(-1.0, 0.05, 0.01) for _ in range(20)]
    assert targets[0] == pytest.approx(0.1)
    assert targets[-1] == 0.5  # no further ahead than a quarter of a second of real time


def test_in_real_time_and_in_a_pause_there_is_no_target():
    assert Pace().target(1.0, 0.05, 0.01) is None
    assert Pace(lockstep=True, paused=True).target(1.0, 0.05, 0.01) is None
