# SPDX-License-Identifier: Apache-2.0
"""The numbers of the model and of the sensors that a recording may contradict."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from kalman_ros import sensors
from kalman_ros.core import Array, Dynamics, Sensor, options_of
from kalman_ros.scenario.building import complete, rebuild
from kalman_ros.scenario.declarations import model_of, options, sensor_names
from kalman_ros.scenario.parameter_files import section
from kalman_ros.scenario.wiring import system

from .evidence import Evidence
from .model_noise import noisier

#: Relative step of numerical derivatives.
STEP = 1e-4
#: Largest number of entries of a list that are varied.
_LONGEST = 36
_MODEL = 'model_parameters'


class Parameter(NamedTuple):
    """A number, an entry of a list, or the factor of a list of noise or of a row of a matrix.

    Parameters
    ----------
    name
        Its name: ``mass``, ``A[3]``, ``A[speed]`` or ``noise_density`` of the model,
        ``imu.radius`` of a sensor.
    value
        Its value; 1 for a factor.
    given
        Function of a value, which returns what the file then has, by full name.
    row
        The state whose row of A and B is multiplied, for such a factor.
    """

    name: str
    value: float
    given: Callable[[float], dict[str, Any]]
    row: str = ''

    def change(self, value: float) -> dict[str, Any]:
        """Return the change of the parameter file to a value, rounded where it changes."""
        before, digits = self.given(self.value), 3 if 'noise' in self.name else 5
        return {key: _rounded(new, before[key], digits) for key, new in self.given(value).items()}


class Varied(NamedTuple):
    """A parameter with a value that is larger by ``size``.

    Parameters
    ----------
    parameter, size
        The parameter, and the change of its value.
    model, sensors
        The model with that value, and the sensors that it changes, by name.
    """

    parameter: Parameter
    size: float
    model: Dynamics
    sensors: Mapping[str, Sensor]


def parameters(evidence: Evidence) -> Iterator[Parameter]:
    """Yield the numbers of the model and of the sensors.

    A number of the model and that of a sensor are one if name and value are the same.
    """
    full = _complete(evidence)
    of_model = [option.name for option in options_of(system(str(full['model'])).build)]
    of_sensors = [
        (f'{name}.{option.name}', option.name)
        for name in sensor_names(full['sensors'])
        for option in sensors.options(full[f'{name}.kind'])
    ]
    shared = set()
    for key in of_model:
        value = full[f'{_MODEL}.{key}']
        also = [name for name, its in of_sensors if its == key and full[name] == value]
        shared.update(also)
        yield from _numbers(key, value, [f'{_MODEL}.{key}', *also])
    if {'states', 'A', 'B'} <= set(of_model):
        yield from _rows(full, [name for name, key in of_sensors if key == 'C'])
    for name, _ in of_sensors:
        if name not in shared:
            yield from _numbers(name, full[name], [name])


def _complete(evidence: Evidence) -> dict[str, Any]:
    """Return a value for every parameter of the scenario."""
    return complete(evidence.parameters, options(evidence.parameters, with_law=False))


def _numbers(name: str, value: Any, keys: list[str]) -> Iterator[Parameter]:
    """Yield the numbers of a value that stands in the file under each of ``keys``."""
    if _is_number(value):
        yield Parameter(name, float(value), lambda new: dict.fromkeys(keys, new))
    elif isinstance(value, list) and all(map(_is_number, value)) and 'noise' in name:
        yield Parameter(name, 1.0, partial(_multiplied, keys, value))
    elif isinstance(value, list) and all(map(_is_number, value)) and len(value) <= _LONGEST:
        for index, entry in enumerate(value):
            if entry != 0.0:
                yield Parameter(
                    f'{name}[{index}]', float(entry), partial(_with_entry, keys, value, index)
                )


def _rows(full: Mapping[str, Any], C: list[str]) -> Iterator[Parameter]:
    """Yield the factor of each row of A and B, as of a mass or a time constant.

    A row of a sensor that is the same, such as that of an accelerometer, has the same factor.
    """
    n, A, B = (len(full[f'{_MODEL}.states']), *(full[f'{_MODEL}.{name}'] for name in 'AB'))
    keys = [f'{_MODEL}.A', f'{_MODEL}.B', *(key for key in C if full[key])]
    A, B = np.reshape(A, (n, n)), np.reshape(B, (n, -1))
    others = [np.reshape(full[key], (-1, n)) for key in keys[2:]]
    for index, state in enumerate(full[f'{_MODEL}.states']):
        if np.count_nonzero(np.hstack((A, B))[index]) < 2:
            continue  # that factor is one of a single number
        this = np.arange(n) == index
        masks = [this, this, *(np.all(matrix == A[index], axis=1) for matrix in others)]
        given = partial(_with_rows, keys, (A, B, *others), masks)
        yield Parameter(f'A[{state}]', 1.0, given, state)


def _with_rows(
    keys: list[str], matrices: Sequence[Array], masks: Sequence[Any], factor: float
) -> dict[str, Any]:
    """Return what a file has where rows are multiplied; what does not change is left out."""
    return {
        key: np.where(rows[:, np.newaxis], factor * matrix, matrix).ravel().tolist()
        for key, matrix, rows in zip(keys, matrices, masks)
        if (matrix[rows] != 0.0).any()
    }


def _multiplied(keys: list[str], value: list[float], factor: float) -> dict[str, Any]:
    return {key: [factor * entry for entry in value] for key in keys}


def _with_entry(keys: list[str], value: list[float], index: int, new: float) -> dict[str, Any]:
    return {key: [*value[:index], new, *value[index + 1 :]] for key in keys}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _rounded(value: Any, before: Any, digits: int) -> Any:
    if isinstance(value, list):
        return [_rounded(*pair, digits) for pair in zip(value, before)]
    return value if value == before else float(f'{value:.{digits}g}')


def parameter(evidence: Evidence, name: str) -> Parameter:
    """Return the number with a name."""
    return next(candidate for candidate in parameters(evidence) if candidate.name == name)


def varied(evidence: Evidence) -> Iterator[Varied]:
    """Yield each number with a changed value."""
    scenario, full = evidence.scenario, _complete(evidence)
    declaration = system(str(full['model']))
    for candidate in parameters(evidence):
        size = STEP * (abs(candidate.value) or 1.0)
        changed = {**full, **candidate.given(candidate.value + size)}
        names = [
            key for key in candidate.given(candidate.value) if not key.startswith(f'{_MODEL}.')
        ]
        try:
            model = scenario.model
            if len(names) < len(candidate.given(candidate.value)):
                model = model_of(declaration, section(changed, _MODEL))
                model = noisier(model, evidence.noise_factor)
            sources = rebuild(scenario, changed, names).sensors
        except ValueError:
            continue
        at = {key.partition('.')[0] for key in names}
        yield Varied(candidate, size, model, {name: sources[name].sensor for name in at})
