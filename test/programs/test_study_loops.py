# SPDX-License-Identifier: Apache-2.0
"""The theory that studies compare with agrees with itself, without the nodes."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import theory
from kalman_ros.control.margins import margins
from kalman_ros.control.state_space import StateSpace
from kalman_ros.programs.study import bandwidth, cost, loops
from kalman_ros.scenario.regulator import price


def test_averages_of_the_best_loop_are_those_of_separation():
    real = scenarios.build(bandwidth.system(0.5, 0.1))
    known = theory(real)
    expected = known.loop.average(known.loop.cost_weight(known.cost)[None], 300)[0]
    found = loops.average(real, price(real).weight, 300)
    assert found.mean == pytest.approx(expected.mean, rel=1e-8)
    assert found.std == pytest.approx(expected.std, rel=1e-4)


def test_averages_of_other_gains_are_their_stationary_cost():
    real, believed = scenarios.build(cost.system()), scenarios.build(cost.system(L=30.0))
    weight = real.rate * price(real).weight
    found = loops.average(real, weight, 1, loops.controller(real, believed))
    assert found.mean == pytest.approx(cost.expected_cost(real, believed), rel=1e-9)


def test_a_loop_at_its_gain_margin_neither_grows_nor_decays():
    real = scenarios.build(cost.system())
    for loop in (loops.lqr_loop(real), loops.lqg_loop(real)):
        known = margins(loop)
        for margin in (known.lower_gain, known.upper_gain):
            if 0.0 < margin.value < np.inf:
                k = margin.value
                changed = StateSpace(loop.A, loop.B, k * loop.C, k * loop.D, loop.dt)
                assert abs(loops.growth(changed)) < 1e-6
