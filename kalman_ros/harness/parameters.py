# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files and command lines, read and written without ROS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml


def from_file(path: Path, node: str) -> dict[str, Any]:
    """Return the parameters that a ROS parameter file has for a node, flat.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    try:
        document = yaml.safe_load(path.read_text()) or {}
        sections = [document.get(key, {}) for key in ('/**', f'/**/{node}', node, f'/{node}')]
        merged: dict[str, Any] = {}
        for section in sections:
            merged.update(_flat(section.get('ros__parameters', {})))
    except (yaml.YAMLError, AttributeError) as error:
        first = str(error).partition('\n')[0]
        raise ValueError(f'{path.name}: not a ROS parameter file: {first}') from None
    return merged


def _flat(section: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, Mapping):
            found.update(_flat(value, f'{prefix}{key}.'))
        else:
            found[f'{prefix}{key}'] = value
    return found


def yaml_value(value: Any) -> str:
    """Return a parameter's value as the command line of a node takes it."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return f'[{", ".join(yaml_value(item) for item in value)}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value))
    return str(value)
