# SPDX-License-Identifier: Apache-2.0
"""One plant a file. The file's name is the model's name, and its ``SYSTEM`` is what it offers."""

from __future__ import annotations

from kalman_ros.core import Model, System, find
from kalman_ros.core.registry import names as _names

#: What the nodes run when they are told nothing.
DEFAULT = 'mass_spring_damper_2d'


def names() -> list[str]:
    """Return the names of the built-in models."""
    return _names(__name__)


def system(name: str) -> System:
    """Return the system that the built-in model ``name`` registers; ValueError if unknown."""
    found = find('model', name, __name__, 'SYSTEM')
    if not isinstance(found, System):
        raise ValueError(f"model: '{name}' is not a System but a {type(found).__name__}")
    return found


def default_model(name: str) -> Model:
    """Return the built-in model ``name`` with its default parameters."""
    return system(name).build()
