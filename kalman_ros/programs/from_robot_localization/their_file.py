# SPDX-License-Identifier: Apache-2.0
"""Reads a parameter file of robot_localization: its nodes, and what they know with which line."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kalman_ros.core import About, Option
from kalman_ros.scenario.parameter_files import Lined, with_lines

SENSOR = re.compile(r'(odom|pose|twist|imu)(\d+)')
_NAVSAT = {
    'datum', 'magnetic_declination_radians', 'yaw_offset', 'zero_altitude', 'wait_for_datum',
    'use_odometry_yaw', 'broadcast_utm_transform', 'broadcast_cartesian_transform',
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """What became of a parameter: its line, its name, whether it is carried over, and how."""

    line: int
    name: str
    carried: bool
    what: str


@dataclass
class TheirNode:
    """The parameters of a node; what is taken is accounted for."""

    name: str
    namespace: str
    values: dict[str, Lined]
    rows: list[Row] = field(default_factory=list)

    @property
    def filters(self) -> bool:
        """Whether it is a filter: it names a sensor."""
        return any(map(SENSOR.fullmatch, self.values))

    @property
    def navigates(self) -> bool:
        """Whether it converts satellite fixes."""
        return not self.filters and bool(_NAVSAT.intersection(self.values))

    def value(self, name: str, default: Any) -> Any:
        """Return a value in the type of its default.

        Raises
        ------
        ValueError
            If it has another; the line is named.
        """
        if name not in self.values:
            return default
        found, line = self.values[name]
        try:
            return Option(name, default, About('')).check(found)
        except (ValueError, OverflowError) as error:
            raise ValueError(f'line {line}: {error}') from None

    def numbers(
        self, name: str, sizes: tuple[int, ...], *, words: bool = False
    ) -> list[float] | None:
        """Return a list of numbers of one of the sizes, without ``words``; None if not given."""
        if name not in self.values:
            return None
        found, line = self.values[name]
        if words and isinstance(found, list):
            found = [each for each in found if not isinstance(each, str)]
        if not isinstance(found, list) or len(found) not in sizes or not all(map(_usable, found)):
            wanted = ' or '.join(map(str, sizes))
            raise ValueError(f'line {line}: {name}: expected {wanted} finite numbers')
        return [float(item) for item in found]

    def note(self, name: str, what: str, *, carried: bool = True) -> None:
        """Account for a parameter, if it is given."""
        if name in self.values:
            row = Row(self.values[name].line, name, carried, what)
            if row not in self.rows:
                self.rows.append(row)

    @property
    def unaccounted(self) -> list[str]:
        """The parameters that were not accounted for."""
        done = {row.name for row in self.rows}
        return [name for name in self.values if name not in done]


def _usable(value: Any) -> bool:
    """Return whether a value is a number that is finite as a float."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def their_nodes(path: Path) -> list[TheirNode]:
    """Return the nodes in a file; a file without nodes, as in ROS 1, is one.

    Raises
    ------
    ValueError
        If no filter of robot_localization is in it, or a launch file has yet to complete it.
    """
    whole = with_lines(path)
    found = list(_nodes(whole.value, (), path.stem)) if isinstance(whole.value, Mapping) else []
    # what stands under a wildcard is for all nodes
    shared = [node for node in found if not node.name and not node.filters]
    nodes = [node for node in found if node.name or node.filters]
    if not any(node.filters for node in nodes):
        expected = 'expected a node with one of odom0, pose0, twist0, imu0'
        raise ValueError(f'{path.name}: {expected}')
    for node in nodes:
        node.name = node.name or path.stem
        if node.filters or node.navigates:
            for each in shared:
                if node.namespace.startswith(each.namespace):
                    node.values = {**each.values, **node.values}
            _refuse_substitutions(node)
    return nodes


def _refuse_substitutions(node: TheirNode) -> None:
    for name, (value, line) in node.values.items():
        if isinstance(value, str) and '$(' in value:
            expected = 'expected a value in place of a launch substitution'
            raise ValueError(f"line {line}: {name}: {expected}, got '{value}'")


def _nodes(values: Mapping[str, Lined], parts: Sequence[str], stem: str) -> Iterator[TheirNode]:
    """Return the nodes below the parts of a name; a wildcard leaves it empty."""
    last = parts[-1] if parts else stem
    name, space = '' if '*' in last else last, [part for part in parts[:-1] if '*' not in part]
    if any(map(SENSOR.fullmatch, values)) or _NAVSAT.intersection(values):
        yield TheirNode(name, '/'.join(space), _flat(values))
        return
    for key, (value, _) in values.items():
        if key == 'ros__parameters' and isinstance(value, Mapping):
            yield TheirNode(name, '/'.join(space), _flat(value))
        elif isinstance(value, Mapping):
            yield from _nodes(value, [*parts, *filter(None, str(key).split('/'))], stem)


def _flat(values: Mapping[str, Lined], start: str = '') -> dict[str, Lined]:
    found: dict[str, Lined] = {}
    for key, entry in values.items():
        if isinstance(entry.value, Mapping):
            found.update(_flat(entry.value, f'{start}{key}.'))
        else:
            found[f'{start}{key}'] = entry
    return found
