# SPDX-License-Identifier: Apache-2.0
"""What is fitted to arrays: the parameters of a scenario, or of a function."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros.analysis.tuning.candidate import Candidate
from kalman_ros.analysis.tuning.free_parameter import FreeParameter, delay_parameter
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.compiled.parts import parts
from kalman_ros.core import Space, TimedSensor, refuse_unknown
from kalman_ros.estimators import build_filter, default_filter
from kalman_ros.estimators.plan import Plan

from .accept import belief_of, got, number
from .passing import Task
from .rows import sensors_of
from .scenarios import values_of


class ScenarioProblem:
    """The parameters of a scenario."""

    def __init__(
        self,
        given: Any,
        names: Any,
        also: Sequence[str],
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        initial: Any,
        filter: str,
    ) -> None:
        values = values_of(given, {'filter': filter} if filter else {}, 'estimator')
        self._named = NamedParameters(values)
        if isinstance(names, Mapping):
            raise ValueError('fit: expected the names of parameters; their starts are those of '
                             'the scenario')  # fmt: skip
        wanted = [names] if isinstance(names, str) else names or self._named.usual
        self.parameters = self._named.choose([*wanted, *also], bounds, priors)
        model = self._named.scenario.model
        self._initial = None if initial is None else belief_of(initial, model)

    def task(self) -> Task:
        """Return the model, sensors and belief at the start."""
        scenario = self._named.scenario
        sensors = {name: source.sensor for name, source in scenario.enabled.items()}
        return Task(
            scenario.model, sensors, self._initial or scenario.initial_belief, scenario.filter
        )

    def changes(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters of the scenario with these values."""
        return self._named.changes(values)

    def candidate(self, values: Mapping[str, float]) -> Candidate:
        """Return the candidate of some values."""
        candidate = self._named.candidate(values)
        return candidate if self._initial is None else replace(candidate, initial=self._initial)


class FunctionProblem:
    """A function from parameters to a model and sensors."""

    def __init__(
        self,
        function: Callable[..., Any],
        starts: Any,
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        linear: Sequence[str],
        initial: Any,
        filter: str,
    ) -> None:
        self._function, self._initial, self._filter = function, initial, filter.lower()
        known = defaults(function)
        if isinstance(starts, Mapping):
            known.update({name: number(name, value) for name, value in starts.items()})
            names = list(starts)
        else:
            names = [starts] if isinstance(starts, str) else list(starts or known)
            refuse_unknown(names, known, 'parameter to fit')
        for what, given in (('bounds', bounds), ('priors', priors), ('linear', linear)):
            refuse_unknown(given, names, f'parameter in {what}')
        if not names:
            raise ValueError(
                "fit: expected the starts of the parameters, such as {'mass': 1.0}, got nothing"
            )
        self._starts = {name: known[name] for name in names}
        self._biases: list[str] = []
        self._delays: list[str] = []
        self.parameters = [
            FreeParameter(
                name, known[name], *bounds.get(name, (-np.inf, np.inf)),
                positive=known[name] > 0.0 and name not in linear,
                scale=abs(known[name]) or 1.0, prior=priors.get(name),
            )
            for name in names
        ]  # fmt: skip

    def add_errors(self, biases: Sequence[str], delays: Sequence[str]) -> None:
        """Fit the biases and delays of some sensors, too."""
        task = self.task()
        self._biases, self._delays = list(biases), list(delays)
        refuse_unknown([*biases, *delays], task.sensors, 'sensor')
        if delays and task.model.is_discrete:
            raise ValueError('delays: expected none, for the model is in discrete time')
        for name in biases:
            output, R = task.sensors[name].output, task.sensors[name].covariance
            for index, label in enumerate(_bias_names(name, output)):
                size = float(np.sqrt(R[index, index]))
                unit = output.units[index]
                self.parameters.append(FreeParameter(label, 0.0, scale=size, unit=unit))
        self.parameters += [delay_parameter(name, 0.0, 0.01) for name in delays]

    def task(self) -> Task:
        """Return the model, sensors and belief at the start."""
        try:
            output = self._function(**self._starts)
        except TypeError as error:
            raise ValueError(f'problem: {error}') from None
        if not isinstance(output, tuple) or len(output) not in (2, 3):
            raise ValueError(
                f'problem: expected a function that returns a model and its sensors, and perhaps '
                f'the first belief, got {got(output)}'
            )
        model, sensors = output[0], sensors_of(output[1], output[0])
        first = output[2] if len(output) == 3 else self._initial
        belief = belief_of(first, model)
        plan = _plan(model, sensors)
        return Task(model, sensors, belief, self._filter or default_filter(plan))

    def changes(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the arguments of the function with these values."""
        return {name: values[name] for name in self._starts}

    def candidate(self, values: Mapping[str, float]) -> Candidate:
        """Return the candidate of some values."""
        model, given, *rest = self._function(**{name: values[name] for name in self._starts})
        sensors = sensors_of(given, model)
        belief = belief_of(rest[0] if rest else self._initial, model)
        plan = _plan(model, sensors)
        kind = self._filter or default_filter(plan)
        biases = {
            name: np.array([values[label] for label in _bias_names(name, sensors[name].output)])
            for name in self._biases
        }
        delays = {name: values[f'{name}.delay'] for name in self._delays}
        fast = parts(model, sensors, one_of_many=True)
        filter = build_filter(kind, plan.computed_by(fast.model, fast.sensors))
        return Candidate(filter, fast.model, fast.sensors, belief, biases, delays)


def _bias_names(name: str, output: Space) -> list[str]:
    if output.size == 1:
        return [f'{name}.bias']
    return [f'{name}.bias.{coordinate}' for coordinate in output.names]


def _plan(model: Any, sensors: Mapping[str, Any]) -> Plan:
    return Plan(model, {name: TimedSensor(sensor, 1.0) for name, sensor in sensors.items()}, 1.0)


def defaults(function: Callable[..., Any]) -> dict[str, float]:
    """Return the arguments of a function that have a number as their default."""
    numbers = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if isinstance(parameter.default, (int, float)) and not isinstance(parameter.default, bool):
            numbers[name] = float(parameter.default)
    return numbers
