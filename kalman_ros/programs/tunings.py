# SPDX-License-Identifier: Apache-2.0
"""The runs of a demo: one, or two with the same seed and other parameters."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
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
    """One run of a demo: its scenario, and the parameters over those of the file.

    ``own`` is the section of the demo in the file, ``label`` names the run, and ``folder`` is for
    its results.
    """

    scenario: str
    parameters: dict[str, Any]
    own: Demo
    label: str
    folder: Path

    @property
    def model(self) -> str:
        """Name of the plant's model."""
        return str(self._values('plant').get('model', models.DEFAULT))

    @property
    def length(self) -> float:
        """Length in m of the part that is drawn; 1 if the model has no length."""
        values = self._values('plant')
        option = scenarios.options(values).get('model_parameters.length')
        if option is None:
            return 1.0
        return float(cast(float, values.get('model_parameters.length', option.default)))

    def _values(self, node: str) -> dict[str, Any]:
        return {**from_file(shipped.file(self.scenario), node), **self.parameters}

    def limits(self, built: Scenario) -> Limits:
        """Return the limits of the actuators, which are parameters of the controller."""
        return regulator.actuators(built, self._values('controller'))[0]


def tunings(options: argparse.Namespace, folder: Path) -> list[Tuning]:
    """Return the requested run, and the one ``--against`` it.

    Raises
    ------
    ValueError
        If a file, a filter or a parameter is unknown.
    """
    first = _tuning(options.scenario, options.parameters, '', folder)
    if not options.against:
        return [first]
    scenario, changes = _compared_run(options.against, options.scenario)
    label = ', '.join([*([Path(scenario).stem] if scenario != options.scenario else []),
                       *(change.replace(':=', '=') for change in changes)])  # fmt: skip
    second = _tuning(scenario, [*options.parameters, *changes], label, folder / 'against')
    for tuning in (first, second):
        read = from_file(shipped.file(tuning.scenario), 'estimator', 'controller')
        refuse_unknown_parameters({**read, **tuning.parameters})
    return [first._replace(label=_values_before(first, overrides(changes))), second]


def _tuning(scenario: str, parameters: Sequence[str], label: str, folder: Path) -> Tuning:
    demo = demo_section(shipped.file(scenario))
    return Tuning(scenario, {**demo.parameters, **overrides(parameters)}, demo, label, folder)


def _compared_run(texts: Sequence[str], scenario: str) -> tuple[str, list[str]]:
    """Return the scenario of ``--against``, and its parameters as NAME:=VALUE."""
    changes = []
    for text in texts:
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


def _values_before(tuning: Tuning, changes: dict[str, Any]) -> str:
    """Return the values that a tuning has in place of ``changes``, as text."""
    values = {**from_file(shipped.file(tuning.scenario), *NODES), **tuning.parameters}
    options = scenarios.options(values)
    texts = []
    for name in changes:
        default = options[name].default if name in options else None
        value = values.get(name, default)
        texts.append(f'{name}={value}' if value is not None else f'without {name}')
    return ', '.join(texts) or Path(tuning.scenario).stem
