# SPDX-License-Identifier: Apache-2.0
"""What is on a live page as a parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kalman_ros.scenario.parameter_files import BETWEEN, NODES, from_file, sections, yaml_value

from .adjustments import Adjustments


def parameter_file(adjustments: Adjustments) -> str:
    """Return a parameter file that starts every node as it is now.

    What the file has for all nodes is under ``/**``, all else in the section of each node.
    """
    between = (BETWEEN,) if BETWEEN in sections(adjustments.file) else ()
    shared = {**from_file(adjustments.file), **adjustments.shared}
    lines = [f'# {adjustments.file.stem}, as it was on a live page.', *_section('/**', shared)]
    for node in (*NODES, *between):
        changes = adjustments.changes.get(node, {})
        values = {**from_file(adjustments.file, node), **adjustments.shared, **changes}
        own = {name: value for name, value in values.items() if shared.get(name) != value}
        if own:
            lines += ['', *_section(node, own)]
    return '\n'.join(lines) + '\n'


def _section(node: str, values: Mapping[str, Any]) -> list[str]:
    return [f'{node}:', '  ros__parameters:', *_lines(_nested(values), '    ')]


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by the parts of their names."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        *parents, last = name.split('.')
        place = found
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return found


def _lines(values: Mapping[str, Any], indent: str) -> list[str]:
    found = []
    for name, value in values.items():
        if isinstance(value, dict):
            found += [f'{indent}{name}:', *_lines(value, f'{indent}  ')]
        else:
            found.append(f'{indent}{name}: {yaml_value(value)}')
    return found
