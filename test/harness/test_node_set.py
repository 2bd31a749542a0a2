# SPDX-License-Identifier: Apache-2.0
"""A mistyped name of a node is refused with the nearest one."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.harness.node_set import NodeSet

SHARED = {'lockstep': True}


@pytest.mark.parametrize(
    'only, nodes, remaps',
    [
        ({'estimatr': {'window': 1.0}}, None, {}),
        ({}, ('estimatr',), {}),
        ({}, None, {'estimatr': {'estimate': 'other'}}),
    ],
)
def test_an_unknown_node_is_refused(only, nodes, remaps):
    with pytest.raises(ValueError, match="unknown node 'estimatr'; did you mean 'estimator'"):
        NodeSet('cart_pole', SHARED, only, nodes, {}, remaps)


def test_further_nodes_are_known():
    found = NodeSet(
        'cart_pole', SHARED, {'observer': {'window': 1.0}}, None, {'observer': 'estimator'}, {}
    )
    assert 'observer' in found.names
