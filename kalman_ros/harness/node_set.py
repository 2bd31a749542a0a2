# SPDX-License-Identifier: Apache-2.0
"""Nodes of a run and their parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kalman_ros import scenario as scenarios
from kalman_ros.core.named_options import refuse_unknown
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.parameter_files import BETWEEN, NODES, from_file, sections
from kalman_ros.scenario.parameter_text import yaml_value

from . import executables


class NodeSet:
    """The nodes of a run by name; the arguments are those of `Run`."""

    def __init__(
        self,
        scenario: str | Mapping[str, Any],
        shared: Mapping[str, Any],
        only: Mapping[str, Mapping[str, Any]],
        nodes: Sequence[str] | None,
        also: Mapping[str, str],
        remaps: Mapping[str, Mapping[str, str]],
    ) -> None:
        executables.prefix()  # reports a workspace that is not sourced before any other error
        self._file = shipped.file(scenario) if isinstance(scenario, str) else None
        inline = {} if isinstance(scenario, str) else dict(scenario)
        between = (BETWEEN,) if BETWEEN in sections(self._file) else ()
        known = (*NODES, BETWEEN, *also)
        refuse_unknown((*only, *remaps, *(nodes or ())), known, 'node')
        self._also = also
        self._parameters = {
            name: {**inline, **shared, **only.get(name, {})}
            for name in (*NODES, *between, *(nodes or ()), *also)
        }
        # the scenario includes parameters that the plant leaves to other nodes
        read = from_file(self._file) if between else from_file(self._file, 'plant')
        #: Scenario according to the parameters of the plant.
        self.scenario: Scenario = scenarios.build({**read, **self._parameters['plant']})
        driven = bool(self.scenario.input.fields)
        needed = NODES if driven else tuple(name for name in NODES if name != 'controller')
        #: Names of the nodes, in the order in which they start.
        self.names = (*((*between, *needed) if nodes is None else nodes), *also)
        self._remaps = dict(remaps)
        if shared['lockstep'] and BETWEEN in self.names:
            self._remaps.setdefault('plant', {'tick': 'plant_tick'})
        if self.scenario.state.topic in self._remaps.get('controller', {}):
            self._parameters['plant'].setdefault('wait_for_estimate', True)

    def command(self, name: str) -> list[str]:
        """Return the command line of a node."""
        program = executables.executable(self._also.get(name, name))
        command = [str(program), '--ros-args', '-r', f'__node:={name}']
        if self._file is not None:
            command += ['--params-file', str(self._file)]
        for key, value in self._parameters[name].items():
            # with the name of the node, since otherwise its section in the file has priority
            command += ['-p', f'{name}:{key}:={yaml_value(value)}']
        for topic, other in self._remaps.get(name, {}).items():
            command += ['-r', f'{topic}:={other}']
        return command
