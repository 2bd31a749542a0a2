# SPDX-License-Identifier: Apache-2.0
"""The ranges of a sweep: ``NAME=LOW..HIGH:log:COUNT`` as a person types it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from kalman_ros.control.limiter import LIMITS
from kalman_ros.core import refuse_unknown
from kalman_ros.simulation.faults.plant_faults import plant_options

#: Prefixes of a parameter of the plant only, and of estimator and controller only.
PLANT, ESTIMATOR = 'plant.', 'estimator.'
_FORM = 'NAME=LOW..HIGH:log:COUNT, or lin'
_MOST = 1000
_PATTERN = re.compile(
    r'(?P<name>[^=\[\]]+)(\[(?P<index>\d+)\])?='
    r'(?P<low>[^:]+?)\.\.(?P<high>[^:]+):(?P<scale>[a-z]+):(?P<count>\d+)'
)


@dataclass(frozen=True)
class Range:
    """The values of one parameter.

    Parameters
    ----------
    label
        Text before the equals sign, as it was typed.
    name
        Name of the parameter, without a prefix.
    index
        Index of the swept number in a list; None for all numbers.
    plant, believed
        Whether the plant has the parameter, and whether estimator and controller have it.
    log
        Whether the values are evenly spaced in their logarithm.
    values
        Values from the lowest to the highest.
    """

    label: str
    name: str
    index: int | None
    plant: bool
    believed: bool
    log: bool
    values: tuple[float, ...]

    def set_in(self, values: Mapping[str, Any], value: float) -> dict[str, Any]:
        """Return parameters in which the swept one has a value.

        Raises
        ------
        ValueError
            If there is no such parameter, or it has no numbers.
        """
        known = plant_options(values)
        refuse_unknown([self.name], {*known, *LIMITS}, 'parameter')
        default = known[self.name].default if self.name in known else [0.0]
        present = values.get(self.name, default)
        if isinstance(default, (str, bool)) or (isinstance(default, list) and _words(default)):
            raise ValueError(f'over: expected a parameter with numbers, got {self.name}')
        if not isinstance(default, list):
            if self.index is not None:
                raise ValueError(f'over: {self.name} is one number, without [{self.index}]')
            return {**values, self.name: round(value) if isinstance(default, int) else value}
        listed = list(present) if isinstance(present, list) else [present]
        if self.index is None:
            listed = [value] * max(1, len(listed))
        elif self.index < len(listed):
            listed[self.index] = value
        else:
            raise ValueError(
                f'over: {self.name} has {len(listed)} numbers, the last is [{len(listed) - 1}], '
                f'got [{self.index}]'
            )
        return {**values, self.name: listed}

    def configured(self, values: Mapping[str, Any]) -> float | None:
        """Return the value without a sweep if it is one number within the range, else None."""
        known = plant_options(values)
        present = values.get(self.name, known[self.name].default if self.name in known else None)
        if self.index is not None:
            present = present[self.index] if isinstance(present, list) else None
        single = present[0] if isinstance(present, list) and len(set(present)) == 1 else present
        within = isinstance(single, (int, float)) and self.values[0] <= single <= self.values[-1]
        return float(single) if within else None


def _words(values: list[Any]) -> bool:
    return any(isinstance(value, str) for value in values)


def parsed(text: str) -> Range:
    """Return the range that a person typed.

    Raises
    ------
    ValueError
        If the text has another form; the message shows the expected one.
    """
    match = _PATTERN.fullmatch(text)
    if match is None:
        raise ValueError(f"over: expected {_FORM}, got '{text}'")
    low, high = (_number(match[end], text) for end in ('low', 'high'))
    scale, count = match['scale'], int(match['count'])
    if scale not in ('log', 'lin'):
        raise ValueError(f"over: expected log or lin, got '{scale}' in '{text}'")
    if not low < high:
        raise ValueError(f"over: expected a low end below the high one, got '{text}'")
    if scale == 'log' and low <= 0.0:
        raise ValueError(f"over: a log range begins above 0; use lin, got '{text}'")
    if not 2 <= count <= _MOST:
        raise ValueError(f"over: expected 2 to {_MOST} values, got {count} in '{text}'")
    space = np.geomspace if scale == 'log' else np.linspace
    label = text.partition('=')[0]
    name = match['name']
    whose = next((prefix for prefix in (PLANT, ESTIMATOR) if name.startswith(prefix)), '')
    return Range(
        label,
        name.removeprefix(whose),
        None if match['index'] is None else int(match['index']),
        whose != ESTIMATOR,
        whose != PLANT,
        scale == 'log',
        tuple(space(low, high, count).tolist()),
    )


def _number(text: str, whole: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not isfinite(value):
        raise ValueError(f"over: expected {_FORM}, and '{text}' is no number, in '{whole}'")
    return value
