# SPDX-License-Identifier: Apache-2.0
"""Faults of the plant's actuator, put in while it runs."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness import Run


@pytest.mark.thorough
def test_gain_and_delay_change_what_the_plant_does_with_the_same_force():
    with Run(overrides={'model_parameters.force_noise': 1e-16}) as run:
        run.advance(1.0)
        run.set_parameter('actuator_gain', [0.5, 2.0])
        run.set_parameter('actuator_delay', 0.02)
        run.advance(1.0)
        found = run.trajectory()
        model = run.scenario.model
    step = model.transition(*model.equilibrium, 0.01)
    x, u = found.truth, found.input
    acted = x[1:] - x[:-1] @ step.F.T
    expected = u[:-3] * [0.5, 2.0] @ step.G.T  # two steps late
    new = found.time[2:-1] > 1.05
    np.testing.assert_allclose(acted[2:][new], expected[new], atol=1e-7)
    assert np.abs(expected[new]).max() > 1e-4


@pytest.mark.thorough
def test_a_gain_for_too_many_inputs_is_refused():
    with Run() as run:
        with pytest.raises(ValueError, match='actuator_gain: expected 1 or 2 numbers, got 3'):
            run.set_parameter('actuator_gain', [1.0, 1.0, 1.0])
        with pytest.raises(ValueError, match='actuator_delay'):
            run.set_parameter('actuator_delay', -0.1)
