# SPDX-License-Identifier: Apache-2.0
"""Physics, one plant a file: the file's name is the model's name, and ``MODEL`` builds it.

``config/NAME.yaml`` has the wiring of a model to topics.
"""

from __future__ import annotations

from collections.abc import Callable

from kalman_ros.core import Dynamics, Space, System, find
from kalman_ros.core.registry import builds
from kalman_ros.core.registry import names as _names

#: The default model of the nodes.
DEFAULT = 'mass_spring_damper_2d'


def names() -> list[str]:
    """Return the names of the built-in models."""
    return _names(__name__)


def find_model(name: str) -> Callable[..., Dynamics] | System:
    """Return the builder of the model ``name``, or a user's `System`; nothing is called.

    ``package.module:Name`` may name a `System`, a subclass of `Model` or `DiscreteModel`, or a
    function that is annotated to return one.

    Raises
    ------
    ValueError
        If there is no such model, or it is not one of the three.
    """
    builder: Callable[..., Dynamics] | System = find('model', name, __name__, 'MODEL')
    if not isinstance(builder, System) and not builds(builder, Dynamics):
        raise ValueError(
            f"model: '{name}' is not a System, a Model or DiscreteModel class, or a function "
            "annotated '-> Model'"
        )
    return builder


def check_spaces(model: Dynamics) -> None:
    """Raise ValueError if a model does not define the spaces of its state and its input."""
    for name in ('state', 'input'):
        space = getattr(model, name, None)
        if not isinstance(space, Space):
            raise ValueError(f'model: its {name}: expected a Space, got {space!r}')
