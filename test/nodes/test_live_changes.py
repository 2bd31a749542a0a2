# SPDX-License-Identifier: Apache-2.0
"""A live change of a parameter builds what it changes, and nothing else."""

import numpy as np
import pytest
from rclpy.parameter import Parameter

from kalman_ros.nodes.controller import node as controller
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator import node as estimator
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.nodes.plant.node import PlantNode
from kalman_ros.scenario import building, declarations


@pytest.fixture
def built(monkeypatch):
    """The names of what is built, in order."""
    names = []

    def count(module, function, name):
        original = getattr(module, function)

        def counted(*arguments, **options):
            names.append(name)
            return original(*arguments, **options)

        monkeypatch.setattr(module, function, counted)

    count(building, 'model_of', 'model')
    count(declarations, 'model_of', 'model')
    count(declarations, 'sensor_options', 'declarations')
    count(building, '_source', 'sensor')
    count(controller, 'feedback', 'law')
    count(estimator, 'observability', 'observability')
    return names


def change(node, name, value):
    result = node.set_parameters_atomically([Parameter(name, value=value)])
    assert result.successful, result.reason


@pytest.mark.parametrize(
    ('kind', 'name', 'value'),
    [
        (EstimatorNode, 'gate_recover_after', 7),
        (EstimatorNode, 'window', 0.5),
        (ControllerNode, 'input_limit', [3.0]),
        (ControllerNode, 'input_lower_limit', [-0.5]),
        (ControllerNode, 'transition_time', 0.25),
        (PlantNode, 'position.dropout', 0.25),
        (PlantNode, 'max_message_size', 5000),
    ],
)
def test_an_option_of_the_node_alone_builds_no_scenario(pair, built, kind, name, value):
    node = pair(kind).node
    before = node.scenario
    del built[:]
    change(node, name, value)
    assert built == []
    assert node.scenario is before


def test_the_noise_of_a_sensor_builds_that_sensor(pair, built):
    node = pair(EstimatorNode).node
    before = node.scenario
    del built[:]
    change(node, 'position.noise', [0.5, 0.25])
    assert built == ['sensor', 'observability']
    after = node.scenario
    assert after.model is before.model
    assert after.sensors['velocity'] is before.sensors['velocity']
    np.testing.assert_allclose(
        after.sensors['position'].sensor.covariance, np.diag([0.25, 0.0625])
    )
    used = node._online._sensors['position']
    np.testing.assert_allclose(used.covariance, np.diag([0.25, 0.0625]))


def test_the_value_that_is_there_builds_nothing(pair, built):
    node = pair(EstimatorNode).node
    noise = list(node.get_parameter('position.noise').value)
    del built[:]
    change(node, 'position.noise', noise)
    assert built == []


def test_a_parameter_of_the_model_builds_all_once(pair, built):
    node = pair(EstimatorNode).node
    del built[:]
    change(node, 'model_parameters.mass', 3.0)
    assert built.count('model') == 1
    assert 'declarations' not in built
    assert node.scenario.model.A[1, 0] != 0.0


def test_a_refused_change_leaves_the_scenario(pair):
    node = pair(EstimatorNode).node
    before = node.scenario
    result = node.set_parameters_atomically([Parameter('position.noise', value=[0.1])])
    assert not result.successful
    assert 'position.noise' in result.reason
    assert node.scenario is before
