# SPDX-License-Identifier: Apache-2.0
"""What the controller makes of the age of an estimate."""

import numpy as np
import pytest
from rclpy.parameter import Parameter

from kalman_ros.core import OperatingPoint
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.scenario import shipped
from kalman_ros.scenario.regulator import feedback, feedback_at

X = np.array([1.0, -2.0, 0.5, 3.0])


@pytest.mark.parametrize(
    ('option', 'age', 'predicted'),
    [('true', 0.2, True), ('true', -0.2, False), ('true', 60.0, False), ('false', 0.2, False)],
)
def test_an_estimate_is_predicted_by_its_age_where_that_is_wanted(
    pair, monkeypatch, option, age, predicted
):
    node = pair(ControllerNode, predict_latency=option).node
    now = node.get_clock().now().nanoseconds
    monkeypatch.setattr(node, '_now', lambda: now)
    u = node._output.value
    expected = node.scenario.model.step(X, u, age) if predicted else X
    np.testing.assert_allclose(node._predicted(now - round(age * 1e9), X), expected, rtol=1e-6)
    assert float(str(node._health.age).split(' / ')[0]) == pytest.approx(1e3 * age, rel=1e-2)


@pytest.mark.parametrize(
    ('name', 'value'), [('input_limit', [3.0, 3.0, 3.0]), ('state_cost', [2.0] * 8)]
)
def test_other_weights_and_limits_keep_the_gains_about_the_set_point(pair, name, value):
    file = str(shipped.file('robot_2d'))
    node = pair(ControllerNode, file, **{'model_parameters.command_time': '0.2'}).node
    rest = node.scenario.model.equilibrium
    held = OperatingPoint(rest.state + 2.5 * (np.arange(8) == 2), rest.input)
    at_rest = node._regulator.feedback.gain
    node._hold(held)
    assert not np.allclose(node._regulator.feedback.gain, at_rest)
    assert node.set_parameters_atomically([Parameter(name, value=value)]).successful
    expected = feedback_at(node.scenario, held, feedback(node.scenario)).gain
    np.testing.assert_array_equal(node._regulator.feedback.gain, expected)
    np.testing.assert_array_equal(node._regulator.target[0], held.state)
    node._hold(OperatingPoint(*rest))
    np.testing.assert_array_equal(node._regulator.feedback.gain, feedback(node.scenario).gain)
