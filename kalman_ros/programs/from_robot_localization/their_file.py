# SPDX-License-Identifier: Apache-2.0
"""Nodes in a parameter file of robot_localization, with the lines of their parameters."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from kalman_ros.core import About, Option
from kalman_ros.scenario.parameter_files import Lined, with_lines

SENSOR = re.compile(r'(odom|pose|twist|imu)([0-9]+)')
#: The node that converts satellite fixes, and the parameters that it alone has.
_NAVSAT_NODE = 'navsat_transform'
_NAVSAT = {
    'datum', 'magnetic_declination_radians', 'yaw_offset', 'zero_altitude', 'wait_for_datum',
    'use_odometry_yaw', 'broadcast_utm_transform', 'broadcast_cartesian_transform',
    'broadcast_utm_transform_as_parent_frame', 'broadcast_cartesian_transform_as_parent_frame',
    'publish_filtered_gps', 'use_local_cartesian', 'delay',
}  # fmt: skip
#: Parameters of either node, which the converter may share.
_OF_BOTH = {'frequency', 'use_sim_time', 'transform_timeout'}
#: Parameters that a filter alone has, beside its sensors.
_FILTER = {
    'world_frame', 'odom_frame', 'map_frame', 'base_link_frame', 'two_d_mode', 'publish_tf',
    'sensor_timeout', 'process_noise_covariance', 'initial_estimate_covariance', 'initial_state',
    'print_diagnostics', 'use_control', 'history_length', 'smooth_lagged_data',
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """Outcome of a parameter: its line, its name, whether it is carried over, and how."""

    line: int
    name: str
    carried: bool
    what: str


@dataclass
class TheirNode:
    """Parameters of a node, and the rows that account for them."""

    name: str
    namespace: str
    values: dict[str, Lined]
    rows: list[Row] = field(default_factory=list)
    #: Parameters whose value cannot be used.
    unusable: set[str] = field(default_factory=set)
    #: Whether its namespace may be any that begins so.
    anywhere: bool = False

    @property
    def filters(self) -> bool:
        """Whether the node is a filter, since it names a sensor."""
        return any(map(SENSOR.fullmatch, self.values))

    @property
    def navigates(self) -> bool:
        """Whether the node converts satellite fixes."""
        return not self.filters and bool(_NAVSAT.intersection(self.values))

    def value(self, name: str, default: Any) -> Any:
        """Return a value of the type of its default; of another type it is left out."""
        if name not in self.values:
            return default
        value, _ = self.values[name]
        try:
            if isinstance(value, str) and '$(' in value:
                raise ValueError(
                    f"expected a value in place of a launch substitution, got '{value}'"
                )
            return Option(name, default, About('')).check(value)
        except (ValueError, OverflowError) as error:
            self.leave_out(name, str(error))
            return default

    def numbers(
        self, name: str, sizes: tuple[int, ...], *, words: bool = False
    ) -> list[float] | None:
        """Return a list of numbers of one of the ``sizes``, or None if there is none.

        With ``words``, strings in the list are skipped.
        """
        if name not in self.values:
            return None
        values, _ = self.values[name]
        if words and isinstance(values, list):
            values = [item for item in values if not isinstance(item, str)]
        if (
            not isinstance(values, list)
            or len(values) not in sizes
            or not all(map(_usable, values))
        ):
            expected = ' or '.join(map(str, sizes))
            self.leave_out(name, f'expected {expected} finite numbers')
            return None
        return [float(item) for item in values]

    def note(self, name: str, outcome: str, *, carried: bool = True) -> None:
        """Account for a parameter, if it is set and usable."""
        if name in self.values and name not in self.unusable:
            row = Row(self.values[name].line, name, carried, outcome)
            if row not in self.rows:
                self.rows.append(row)

    def add(self, name: str, outcome: str) -> None:
        """Account for a parameter that counts though the file does not have it."""
        self.rows.append(Row(0, name, True, outcome))

    def leave_out(self, name: str, why: str) -> None:
        """Account for a parameter whose value cannot be used."""
        if name in self.unusable:
            return
        self.rows[:] = [row for row in self.rows if row.name != name]
        self.note(name, f'left out: {why.removeprefix(f"{name}: ")}', carried=False)
        self.unusable.add(name)

    @property
    def unaccounted(self) -> list[str]:
        """Names of the parameters that are not accounted for."""
        done = {row.name for row in self.rows}
        return [name for name in self.values if name not in done]


def _usable(value: Any) -> bool:
    """Return whether a value is a number that is finite as a float."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def their_nodes(path: Path) -> list[TheirNode]:
    """Return the nodes in a file; a file without nodes, as in ROS 1, is one node.

    Raises
    ------
    ValueError
        If the file has no filter of robot_localization.
    """
    whole = with_lines(path)
    all_nodes = (
        list(_nodes(whole.value, (), path.stem)) if isinstance(whole.value, Mapping) else []
    )
    # parameters under a wildcard are for all nodes; alone, they are those of one filter
    named = [
        node for node in all_nodes if node.name and (node.filters or _FILTER & {*node.values})
    ]
    shared = [node for node in all_nodes if not node.name and (named or not node.filters)]
    nodes = [node for node in all_nodes if node not in shared]
    if not any(node.filters for node in all_nodes):
        expected = 'expected a node with one of odom0, pose0, twist0, imu0'
        raise ValueError(f'{path.name}: {expected}')
    for node in nodes:
        given, node.name = node.name, in_ros(node.name or path.stem)
        if given and given != node.name:
            line = min((value.line for value in node.values.values()), default=1)
            words = f"node {node.name}: '{given}' is no name in ROS 2"
            node.rows.append(Row(max(1, line - 1), given, False, words))
        node.namespace = '/'.join(map(in_ros, filter(None, node.namespace.split('/'))))
        for wildcard in shared:
            if f'{node.namespace}/'.startswith(f'{wildcard.namespace}/'.lstrip('/')):
                given_to = _NAVSAT | _OF_BOTH if node.navigates else {*wildcard.values}
                if node.navigates or node.filters or node in named:
                    for_it = {k: v for k, v in wildcard.values.items() if k in given_to}
                    node.values = _merged(for_it, node.values)
    filters = dict.fromkeys(node.namespace for node in nodes if node.filters)
    for node in [node for node in nodes if node.navigates and node.anywhere]:
        spaces = [space for space in filters if space.startswith(node.namespace)]
        if node.namespace not in spaces:
            nodes.remove(node)
            nodes += [replace(node, namespace=space, rows=[*node.rows]) for space in spaces]
    converters = {node.namespace: node for node in nodes if node.navigates}
    for node in [node for node in nodes if node.filters and _NAVSAT & {*node.values}]:
        converter = _split(node)
        if node.namespace not in converters:
            converters[node.namespace] = converter
            nodes.append(converter)
    return nodes


def _split(node: TheirNode) -> TheirNode:
    """Return the converter of fixes whose parameters stand among those of a filter, as under /**.

    The filter has them no longer.
    """
    given, node.values = node.values, {}
    converter = TheirNode(_NAVSAT_NODE, node.namespace, {})
    for name, value in given.items():
        (converter if name in _NAVSAT else node).values[name] = value
    return converter


def in_ros(part: str) -> str:
    """Return a part of a name with what ROS 2 refuses in it replaced."""
    mended = re.sub(r'[^A-Za-z0-9_]', '_', part)
    return f'_{mended}' if mended[0].isdigit() else mended


def _merged(shared: Mapping[str, Lined], specific: Mapping[str, Lined]) -> dict[str, Lined]:
    """Return the values for a node, of which the last in the file counts, as in ROS."""
    merged = {**shared, **specific}
    for name in shared.keys() & specific.keys():
        merged[name] = max(shared[name], specific[name], key=lambda value: value.line)
    return merged


def _nodes(values: Mapping[str, Lined], parts: Sequence[str], stem: str) -> Iterator[TheirNode]:
    """Yield the nodes below the parts of a name; a wildcard leaves the name empty."""
    last = parts[-1] if parts else stem
    name, space = '' if '*' in last else last, [part for part in parts[:-1] if '*' not in part]
    if any(map(SENSOR.fullmatch, values)) or _NAVSAT.intersection(values):
        yield TheirNode(name, '/'.join(space), _flat(values), anywhere=len(space) < len(parts) - 1)
        return
    for key, (value, _) in values.items():
        if key == 'ros__parameters' and isinstance(value, Mapping):
            wild = len(space) < len(parts) - 1
            yield TheirNode(name, '/'.join(space), _flat(value), anywhere=wild)
        elif isinstance(value, Mapping):
            yield from _nodes(value, [*parts, *filter(None, str(key).split('/'))], stem)


def _flat(values: Mapping[str, Lined], start: str = '') -> dict[str, Lined]:
    flat: dict[str, Lined] = {}
    for key, entry in values.items():
        if isinstance(entry.value, Mapping):
            flat.update(_flat(entry.value, f'{start}{key}.'))
        else:
            flat[f'{start}{key}'] = entry
    return flat
