# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of a live page, with the changes of the user."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from kalman_ros.core import Option, Value
from kalman_ros.nodes.controller.options import ControllerOptions
from kalman_ros.nodes.plant.options import PlantOptions
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.settings import (
    OF_RCLPY,
    Chosen,
    Settings,
    choose,
    estimator_extra,
    settings,
)
from kalman_ros.scenario import Scenario, assemble, sensor_names
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.law import kept
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation.faults import options_of_sensors

#: Options of each kind of node, and whether the node needs the control law.
_OPTIONS = {
    'plant': (PlantOptions, False),
    'estimator': (EstimatorOptions, False),
    'controller': (ControllerOptions, True),
}
#: Nodes that share the believed parameters.
BELIEVERS = ('estimator', 'controller', 'monitor')


class Adjustments:
    """The checked parameters of plant, estimator and controller.

    The estimator takes the noise from its parameters, not from the messages of the plant, so that
    the believed noise can differ from the actual noise.

    Parameters
    ----------
    file
        Parameter file.
    parameters
        Parameters for every node, which override those of the file.

    Raises
    ------
    ValueError
        If a parameter is unknown or invalid.
    """

    def __init__(self, file: Path, parameters: Mapping[str, Any]) -> None:
        self.file = file
        demo = demo_section(file)
        #: Duration in seconds of the demo of the scenario.
        self.duration = 60.0 if demo.duration is None else demo.duration
        #: Units of time and of rates: s and Hz, unless a second represents another unit of time.
        self.time_unit, self.rate_unit = demo.time_unit, demo.rate_unit
        self.shared: dict[str, Any] = {**demo.parameters, **parameters}
        #: Changes of parameters, by the names of nodes.
        self.changes: dict[str, dict[str, Any]] = {}
        self._read: dict[str, dict[str, Any]] = {}
        self._chosen: dict[str, Chosen] = {}
        for node in _OPTIONS:
            self._choose(node)
        for name in self.sensors:
            self.change('estimator', {f'{name}.covariance_from': 'configuration'}, tried=True)

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors."""
        return sensor_names(self.value('plant', 'sensors'))

    @property
    def driven(self) -> bool:
        """Whether the model has an input."""
        return 'input.topic' in self._chosen['plant'].values

    def value(self, node: str, name: str) -> Any:
        """Return the value of a parameter of a node; raise KeyError if the node has none."""
        return self._chosen[node].values[name]

    def known(self, node: str) -> Mapping[str, Option]:
        """Return the options of a node, by name."""
        return self._chosen[node].known

    def change(self, node: str, values: Mapping[str, Any], *, tried: bool = False) -> None:
        """Change parameters of a node, all or none.

        Parameters
        ----------
        node, values
            Name of the node, and values of parameters by name.
        tried
            Whether the running node checks that it can be configured with the values.

        Raises
        ------
        ValueError
            If a parameter is unknown or invalid or, unless ``tried``, if no filter or gain exists.
        """
        previous = self.changes.get(node, {})
        self.changes[node] = {**previous, **values}
        if node not in _OPTIONS:
            return
        previous_choice = self._chosen[node]
        try:
            self._choose(node)
            if not tried:
                self._check_configurable(node)
        except ValueError:
            self.changes[node], self._chosen[node] = previous, previous_choice
            raise

    def forget(self, node: str, before: Mapping[str, Any]) -> None:
        """Restore the ``changes`` of a node from before a change that was refused."""
        self.changes[node] = dict(before)
        if node in _OPTIONS:
            self._choose(node)

    def given(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node that are not defaults; ``''`` is for all nodes."""
        if node not in self._read:
            self._read[node] = from_file(self.file, *filter(None, [node]))
        changes = self.changes.get(node, {})
        given = {**self._read[node], **self.shared, **changes}
        return kept(given) if 'law' in changes else given

    def at_start(self, node: str) -> dict[str, Any]:
        """Return the changes with which a process of a node starts.

        A law that lacks the limits of states that are given is not among them: it is set later.
        """
        changes = self.changes.get(node, {})
        everything = {**self._read.get(node, {}), **self.shared, **changes}
        if 'law' not in changes or kept(everything) == everything:
            return {**changes}
        return {name: value for name, value in kept(changes).items() if name != 'law'}

    def _choose(self, node: str) -> None:
        options, with_law = _OPTIONS[node]
        parameters = {
            name: value
            for name, value in self.given(node).items()
            if not name.startswith(OF_RCLPY)
        }
        extra = {'plant': _faults, 'estimator': estimator_extra}.get(node, lambda _: ())
        self._chosen[node] = choose(parameters, options, extra, with_law=with_law)

    def _check_configurable(self, node: str) -> None:
        """Raise ValueError if the node cannot be configured."""
        if node == 'estimator':
            self.estimator_settings().estimator()
        elif node == 'controller' and self.driven:
            feedback(self.scenario(node))
        else:
            self.scenario(node)

    def estimator_settings(self, filter: str = '') -> Settings:
        """Return the settings of the estimator, or those with another filter.

        Raises
        ------
        ValueError
            If the filter is unknown.
        """
        chosen = self._chosen['estimator']
        if filter and filter != self.value('estimator', 'filter'):
            extra = {option.name for option in estimator_extra(chosen.values)}
            given = {name: v for name, v in self.given('estimator').items() if name not in extra}
            return settings({**given, 'filter': filter})
        options: dict[str, Any] = {name: chosen.values[name] for name in chosen.own}
        scenario = self.scenario('estimator')
        return Settings(scenario, EstimatorOptions(**options), scenario.filter_options)

    def scenario(self, node: str) -> Scenario:
        """Return the scenario according to the parameters of a node."""
        chosen, (_, with_law) = self._chosen[node], _OPTIONS[node]
        values = {name: chosen.values[name] for name in chosen.shared}
        assembled = assemble(values, with_law=with_law)
        if node != 'estimator':
            return assembled
        return replace(assembled, filter_options={n: chosen.values[n] for n in chosen.extra})

    def believed(self) -> Scenario:
        """Return the scenario of the controller, with sensors and filter of the estimator."""
        estimator, controller = self.scenario('estimator'), self.scenario('controller')
        return replace(
            controller,
            sensors=estimator.sensors,
            filter=estimator.filter,
            filter_options=estimator.filter_options,
        )


def _faults(chosen: Mapping[str, Value]) -> Iterable[Option]:
    return options_of_sensors(sensor_names(chosen['sensors']))
