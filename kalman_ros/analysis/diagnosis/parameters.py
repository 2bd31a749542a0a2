# SPDX-License-Identifier: Apache-2.0
"""The numbers of a model that a recording may contradict."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from kalman_ros.core import Dynamics, options_of
from kalman_ros.scenario.declarations import model_of
from kalman_ros.scenario.parameter_files import section
from kalman_ros.scenario.wiring import system

from .evidence import Evidence

#: Relative step of numerical derivatives.
STEP = 1e-4
#: Largest number of entries of a list that are varied.
_LONGEST = 36


class Parameter(NamedTuple):
    """A number, an entry of a list, or the factor of a list of noise.

    Parameters
    ----------
    name
        Its name in the file, such as ``mass``, ``A[3]`` or ``noise_density``.
    value
        Its value; 1 for the factor of a list.
    given
        Function of a value, which returns what the file then has, by name.
    """

    name: str
    value: float
    given: Callable[[float], dict[str, Any]]

    def change(self, value: float) -> dict[str, Any]:
        """Return the change of the parameter file to a value, rounded."""
        return {f'model_parameters.{key}': _rounded(new) for key, new in self.given(value).items()}


def parameters(evidence: Evidence) -> Iterator[Parameter]:
    """Yield the numbers of the model."""
    values = section(evidence.parameters, 'model_parameters')
    for option in options_of(system(str(evidence.parameters.get('model', ''))).build):
        yield from _numbers(option.name, values.get(option.name, option.default))


def _numbers(key: str, value: Any) -> Iterator[Parameter]:
    if _is_number(value):
        yield Parameter(key, float(value), lambda new: {key: new})
    elif isinstance(value, list) and all(map(_is_number, value)) and 'noise' in key:
        yield Parameter(key, 1.0, lambda factor: {key: [factor * each for each in value]})
    elif isinstance(value, list) and all(map(_is_number, value)) and len(value) <= _LONGEST:
        for index, entry in enumerate(value):
            if entry != 0.0:
                yield Parameter(
                    f'{key}[{index}]', float(entry), partial(_with_entry, key, value, index)
                )


def _with_entry(key: str, value: list[float], index: int, new: float) -> dict[str, Any]:
    return {key: [*value[:index], new, *value[index + 1 :]]}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return float(f'{value:.3g}')


def parameter(evidence: Evidence, name: str) -> Parameter:
    """Return the number of the model with a name."""
    return next(each for each in parameters(evidence) if each.name == name)


def varied(evidence: Evidence) -> Iterator[tuple[Parameter, Dynamics, float]]:
    """Yield each number of the model, the model with a changed value, and the change."""
    values = section(evidence.parameters, 'model_parameters')
    declaration = system(str(evidence.parameters.get('model', '')))
    for each in parameters(evidence):
        size = STEP * (abs(each.value) or 1.0)
        try:
            yield each, model_of(declaration, {**values, **each.given(each.value + size)}), size
        except ValueError:
            continue
