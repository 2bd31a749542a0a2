# SPDX-License-Identifier: Apache-2.0
"""Nodes of a scenario for viewers, in real time and in a private domain."""

from __future__ import annotations

from kalman_ros.harness.launched_nodes import LaunchedNodes
from kalman_ros.harness.node_set import NodeSet

from .adjustments import Adjustments
from .map_extent import is_drawn


class ViewedNodes(LaunchedNodes):
    """The running nodes of a scenario in a private domain; a context manager.

    Parameters
    ----------
    adjustments
        Parameters of the nodes.
    seed
        Seed of all noise.
    """

    def __init__(self, adjustments: Adjustments, seed: int) -> None:
        shared = {**adjustments.shared, 'seed': seed, 'lockstep': False}
        also, only = {}, dict(adjustments.changes)
        if is_drawn(adjustments.scenario('estimator')):
            also['markers'] = 'markers'
            only['markers'] = {'frame': adjustments.value('estimator', 'frame')}
        nodes = NodeSet(str(adjustments.file), shared, only, None, also, {})
        super().__init__(nodes)

    def __enter__(self) -> ViewedNodes:
        self.open(sockets=True)
        with self.starting():
            self.launch()
        return self
