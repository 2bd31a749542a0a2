# SPDX-License-Identifier: Apache-2.0
"""What an estimator reports that waits for simulated time."""

from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.middleware.diagnostics import Level


def test_simulated_time_without_a_clock_is_a_warning(pair):
    level, message, _ = pair(EstimatorNode, use_sim_time='true').node.report()
    assert (level, message) == (Level.WARN, 'use_sim_time: nothing is received on /clock')


def test_real_time_needs_no_clock(pair):
    assert '/clock' not in pair(EstimatorNode).node.report()[1]
