# SPDX-License-Identifier: Apache-2.0
"""The nodes of a scenario in real time, for viewers: started together, in a private domain."""

from __future__ import annotations

from kalman_ros.harness.launched_nodes import LaunchedNodes
from kalman_ros.harness.node_set import NodeSet

from .adjustments import Adjustments
from .map_extent import is_drawn


class ViewedNodes(LaunchedNodes):
    """Running nodes in a private domain; a context manager.

    Parameters
    ----------
    found
        Their parameters.
    seed
        Of all noise.
    """

    def __init__(self, found: Adjustments, seed: int) -> None:
        shared = {**found.shared, 'seed': seed, 'lockstep': False}
        also, only = {}, dict(found.changes)
        if is_drawn(found.scenario('estimator')):
            also['markers'] = 'markers'
            only['markers'] = {'frame': found.value('estimator', 'frame')}
        nodes = NodeSet(str(found.file), shared, only, None, also, {})
        super().__init__(nodes)

    def __enter__(self) -> ViewedNodes:
        self.open(sockets=True)
        with self.starting():
            self.launch()
        return self
