# SPDX-License-Identifier: Apache-2.0
"""The nodes of a scenario in real time, for viewers: started together, in a private domain."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kalman_ros.harness.launched_nodes import LaunchedNodes
from kalman_ros.harness.node_set import NodeSet
from kalman_ros.harness.readiness import missing
from kalman_ros.scenario import Scenario

from .adjustments import Adjustments

#: Seconds in which the nodes must be connected.
_PATIENCE = 60.0


class ViewedNodes(LaunchedNodes):
    """Running nodes whose parameters are those of a live page; a context manager.

    Parameters
    ----------
    file
        A parameter file.
    parameters
        For every node, over those of the file.
    seed
        Of all noise.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """

    def __init__(self, file: Path, parameters: Mapping[str, Any], seed: int) -> None:
        found = Adjustments(file, parameters)
        shared = {**found.shared, 'seed': seed, 'lockstep': False}
        nodes = NodeSet(str(file), shared, found.changes, None, {}, {})
        super().__init__(nodes)
        self.scenario: Scenario = nodes.scenario
        self._names = nodes.names

    def __enter__(self) -> ViewedNodes:
        self.open(sockets=True)
        try:
            self.listen()
            for name in self._names:
                self.start(name)
            self.wait(
                lambda: not missing(self._names, self.diagnostics, ()),
                _PATIENCE,
                lambda: f'not ready: {missing(self._names, self.diagnostics, ())}',
            )
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
