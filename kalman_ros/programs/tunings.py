# SPDX-License-Identifier: Apache-2.0
"""The runs that a demo is asked for: one, or two with the same seed and other parameters."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, cast

from kalman_ros import models
from kalman_ros import scenario as scenarios
from kalman_ros.control.limiter import Limits
from kalman_ros.estimators import FILTERS
from kalman_ros.scenario import Scenario, regulator, shipped
from kalman_ros.scenario.demo_section import Demo, demo_section
from kalman_ros.scenario.parameter_files import NODES, from_file, overrides

from .known_parameters import refuse_unknown_parameters


class Tuning(NamedTuple):
    """One of the runs: its scenario, the parameters over those of the file, and what it is called.

    ``folder`` is that of its results.
    """

    scenario: str
    parameters: dict[str, Any]
    own: Demo
    label: str
    folder: Path

    @property
    def model(self) -> str:
        """The name of the plant's model."""
        return str(self._values('plant').get('model', models.DEFAULT))

    @property
    def length(self) -> float:
        """The length in m of the part that is drawn; 1 where the model has none."""
        values = self._values('plant')
        option = scenarios.options(values).get('model_parameters.length')
        if option is None:
            return 1.0
        return float(cast(float, values.get('model_parameters.length', option.default)))

    def _values(self, node: str) -> dict[str, Any]:
        return {**from_file(shipped.file(self.scenario), node), **self.parameters}

    def limits(self, built: Scenario) -> Limits:
        """Return the limits of the actuators, which are parameters of the controller."""
        values = self._values('controller')
        names = ('input_limit', 'input_rate_limit')
        return regulator.limits(built, *(values.get(name, inf) for name in names))


def tunings(options: argparse.Namespace, folder: Path) -> list[Tuning]:
    """Return the run that is asked for, and the one ``--against`` it.

    Raises
    ------
    ValueError
        If a file, a filter or a parameter is unknown.
    """
    first = _tuning(options.scenario, options.parameters, '', folder)
    if not options.against:
        return [first]
    scenario, changes = _other(options.against, options.scenario)
    label = ', '.join([*([Path(scenario).stem] if scenario != options.scenario else []),
                       *(change.replace(':=', '=') for change in changes)])  # fmt: skip
    second = _tuning(scenario, [*options.parameters, *changes], label, folder / 'against')
    for tuning in (first, second):
        read = from_file(shipped.file(tuning.scenario), 'estimator', 'controller')
        refuse_unknown_parameters({**read, **tuning.parameters})
    return [first._replace(label=_before(first, overrides(changes))), second]


def _tuning(scenario: str, parameters: Sequence[str], label: str, folder: Path) -> Tuning:
    own = demo_section(shipped.file(scenario))
    return Tuning(scenario, {**own.parameters, **overrides(parameters)}, own, label, folder)


def _other(given: Sequence[str], scenario: str) -> tuple[str, list[str]]:
    """Return the scenario of ``--against``, and its parameters as NAME:=VALUE."""
    changes = []
    for text in given:
        name, separator, value = text.partition('=')
        if text in FILTERS:
            changes.append(f'filter:={text}')
        elif text.endswith(('.yaml', '.yml')) or text in shipped.names():
            scenario = text
        elif separator and name.rstrip(':').strip():
            changes.append(f'{name.rstrip(":").strip()}:={value.strip()}')
        else:
            raise ValueError(
                f'--against: expected NAME=VALUE, a filter ({", ".join(FILTERS)}) or a '
                f"parameter file, got '{text}'"
            )
    names = [change.partition(':=')[0] for change in changes]
    for name in names:
        if name == 'seed':
            raise ValueError('--against: expected another parameter than seed, which both share')
        if names.count(name) > 1:
            raise ValueError(f'--against: expected one value of {name}, got {names.count(name)}')
    return scenario, changes


def _before(tuning: Tuning, changes: dict[str, Any]) -> str:
    """Return what a tuning has instead of ``changes``, as text."""
    values = {**from_file(shipped.file(tuning.scenario), *NODES), **tuning.parameters}
    options = scenarios.options(values)
    found = []
    for name in changes:
        default = options[name].default if name in options else None
        value = values.get(name, default)
        found.append(f'{name}={value}' if value is not None else f'without {name}')
    return ', '.join(found) or Path(tuning.scenario).stem
