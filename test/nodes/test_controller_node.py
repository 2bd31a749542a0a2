# SPDX-License-Identifier: Apache-2.0
"""What the controller makes of the age of an estimate."""

import numpy as np
import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from kalman_ros.control.motion import Motion
from kalman_ros.core import DesignError, OperatingPoint
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.scenario import regulator, shipped
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


def test_a_stop_ends_a_motion_also_where_the_law_has_no_gains(pair, monkeypatch):
    file = str(shipped.file('robot_2d'))
    node = pair(ControllerNode, file, **{'model_parameters.command_time': '0.2'}).node
    rest, law = node.scenario.model.equilibrium, node._gains.law
    states = np.tile(rest.state + 2.5 * (np.arange(8) == 2), (50, 1))
    node._regulator.follow_motion(
        Motion(node.scenario.model.state, 0.01, states, np.tile(rest.input, (50, 1)))
    )

    def none(*arguments):
        raise DesignError('no input moves it there')

    monkeypatch.setattr(regulator, 'feedback_at', none)
    node._on_stop(Bool(data=True))
    assert node._regulator.motion is None and node._regulator.feedback is law
    assert not node._stop.reset()  # the topic is still true
    with pytest.raises(DesignError):
        node._gains.at(OperatingPoint(states[0], rest.input))
