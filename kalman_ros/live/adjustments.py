# SPDX-License-Identifier: Apache-2.0
"""The parameters of each node of a live page, and what a person changed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from kalman_ros.core import Option, Value
from kalman_ros.nodes.controller.options import ControllerOptions
from kalman_ros.nodes.plant.options import PlantOptions
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.settings import OF_RCLPY, Chosen, Settings, choose, estimator_extra
from kalman_ros.scenario import Scenario, assemble, sensor_names
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation.faults import options_of_sensors

#: Kind of node to its options, and whether it has the control law.
_OPTIONS = {
    'plant': (PlantOptions, False),
    'estimator': (EstimatorOptions, False),
    'controller': (ControllerOptions, True),
}
#: Nodes that share what is believed.
BELIEVERS = ('estimator', 'controller', 'monitor')


class Adjustments:
    """The checked parameters of plant, estimator and controller.

    The estimator's noise is that of its parameters, not that in the messages of the plant: so
    what it believes can differ from what is.

    Parameters
    ----------
    file
        A parameter file.
    parameters
        For every node, over those of the file.

    Raises
    ------
    ValueError
        If a parameter is unknown or wrong.
    """

    def __init__(self, file: Path, parameters: Mapping[str, Any]) -> None:
        self.file = file
        demo = demo_section(file)
        #: Seconds that the demo of the scenario takes.
        self.duration = 60.0 if demo.duration is None else demo.duration
        #: The units of time and of rates: s and Hz, unless a second stands for another time.
        self.time_unit, self.rate_unit = demo.time_unit, demo.rate_unit
        self.shared: dict[str, Any] = {**demo.parameters, **parameters}
        #: Changes of single nodes, by their names.
        self.changes: dict[str, dict[str, Any]] = {}
        self._read: dict[str, dict[str, Any]] = {}
        self._chosen: dict[str, Chosen] = {}
        for node in _OPTIONS:
            self._choose(node)
        for name in self.sensors:
            self.change('estimator', {f'{name}.covariance_from': 'configuration'}, tried=True)

    @property
    def sensors(self) -> list[str]:
        """The names of the sensors."""
        return sensor_names(self.value('plant', 'sensors'))

    @property
    def driven(self) -> bool:
        """Whether the model has an input."""
        return 'input.topic' in self._chosen['plant'].values

    def value(self, node: str, name: str) -> Any:
        """Return a parameter of a node; KeyError if it has none of that name."""
        return self._chosen[node].values[name]

    def known(self, node: str) -> Mapping[str, Option]:
        """Return the parameters of a node."""
        return self._chosen[node].known

    def change(self, node: str, values: Mapping[str, Any], *, tried: bool = False) -> None:
        """Change parameters of a node, all or none.

        Parameters
        ----------
        node, values
            The name of the node, and the parameters by their names.
        tried
            Whether the node itself finds out if it can be configured with them.

        Raises
        ------
        ValueError
            If one is unknown or wrong, or, unless ``tried``, no filter or gain exists with them.
        """
        before = self.changes.get(node, {})
        self.changes[node] = {**before, **values}
        if node not in _OPTIONS:
            return
        chosen = self._chosen[node]
        try:
            self._choose(node)
            if not tried:
                self._try(node)
        except ValueError:
            self.changes[node], self._chosen[node] = before, chosen
            raise

    def forget(self, node: str, before: Mapping[str, Any]) -> None:
        """Go back to earlier ``changes`` of a node, which a refused change has replaced."""
        self.changes[node] = dict(before)
        if node in _OPTIONS:
            self._choose(node)

    def given(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node that are not defaults; of all nodes for ``''``."""
        if node not in self._read:
            self._read[node] = from_file(self.file, *filter(None, [node]))
        return {**self._read[node], **self.shared, **self.changes.get(node, {})}

    def _choose(self, node: str) -> None:
        options, with_law = _OPTIONS[node]
        ours = {
            name: value
            for name, value in self.given(node).items()
            if not name.startswith(OF_RCLPY)
        }
        extra = {'plant': _faults, 'estimator': estimator_extra}.get(node, lambda _: ())
        self._chosen[node] = choose(ours, options, extra, with_law=with_law)

    def _try(self, node: str) -> None:
        """Raise ValueError if the node could not be configured."""
        if node == 'estimator':
            found = self._chosen[node]
            own: dict[str, Any] = {name: found.values[name] for name in found.own}
            extra = {name: found.values[name] for name in found.extra}
            Settings(self.scenario(node), EstimatorOptions(**own), extra).estimator()
        elif node == 'controller' and self.driven:
            feedback(self.scenario(node))
        else:
            self.scenario(node)

    def scenario(self, node: str) -> Scenario:
        """Return what a node takes for the scenario."""
        found, (_, with_law) = self._chosen[node], _OPTIONS[node]
        return assemble({name: found.values[name] for name in found.shared}, with_law=with_law)

    def believed(self) -> Scenario:
        """Return what the controller takes for the scenario, with the estimator's sensors."""
        estimator, controller = self.scenario('estimator'), self.scenario('controller')
        return replace(controller, sensors=estimator.sensors, filter=estimator.filter)

    def filter_options(self) -> dict[str, Value]:
        """Return the options of the estimator's filter."""
        found = self._chosen['estimator']
        return {name: found.values[name] for name in found.extra}


def _faults(chosen: Mapping[str, Value]) -> Iterable[Option]:
    return options_of_sensors(sensor_names(chosen['sensors']))
