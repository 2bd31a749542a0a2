# SPDX-License-Identifier: Apache-2.0
"""What the controller makes of the age of an estimate."""

import numpy as np
import pytest

from kalman_ros.nodes.controller.node import ControllerNode

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
