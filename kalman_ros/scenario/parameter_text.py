# SPDX-License-Identifier: Apache-2.0
"""Parameters as the text of a ROS parameter file, or of a command line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np


def section_text(node: str, values: Mapping[str, Any]) -> str:
    """Return the section of a node, with parameters nested by the parts of their names."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *where, last = name.split('.')
        branch = tree
        for part in where:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return '\n'.join([f'{node}:', '  ros__parameters:', *_branches(tree, '    '), ''])


def _branches(tree: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield f'{indent}{name}:'
            yield from _branches(value, f'{indent}  ')
        else:
            yield f'{indent}{name}: {yaml_value(value)}'


def yaml_value(value: Any) -> str:
    """Return a parameter's value as a node's command line accepts it."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        if any(isinstance(item, float) for item in value):  # a ROS list has numbers of one type
            value = [float(item) if type(item) is int else item for item in value]
        return f'[{", ".join(yaml_value(item) for item in value)}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value)).replace('inf', '.inf').replace('nan', '.nan')
    if isinstance(value, str):
        if not value.isprintable():  # YAML's escapes are those of Python
            return '"{}"'.format(ascii(value)[1:-1].replace("\\'", "'").replace('"', '\\"'))
        quoted = value.replace("'", "''")
        return f"'{quoted}'"  # unquoted, an empty string is null and y is true
    return str(value)
