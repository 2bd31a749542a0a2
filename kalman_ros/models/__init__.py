# SPDX-License-Identifier: Apache-2.0
"""Physics, one plant a file: the file's name is the model's name, and ``MODEL`` builds it.

How a model is wired to topics is said in ``config/NAME.yaml``.
"""

from __future__ import annotations

from collections.abc import Callable

from kalman_ros.core import Model, Space, System, find
from kalman_ros.core.registry import builds
from kalman_ros.core.registry import names as _names

#: What the nodes run when they are told nothing.
DEFAULT = 'mass_spring_damper_2d'


def names() -> list[str]:
    """Return the names of the built-in models."""
    return _names(__name__)


def find_model(name: str) -> Callable[..., Model] | System:
    """Return what builds the model of ``name``, or a `System` of one's own; nothing is called.

    ``package.module:Name`` may name a `System`, a subclass of `Model`, or a function that is
    annotated to return one.

    Raises
    ------
    ValueError
        If there is none, or it is none of the three.
    """
    found: Callable[..., Model] | System = find('model', name, __name__, 'MODEL')
    if not isinstance(found, System) and not builds(found, Model):
        raise ValueError(
            f"model: '{name}' is not a System, a Model class or a function annotated '-> Model'"
        )
    return found


def check_spaces(model: Model) -> None:
    """Raise ValueError if a model does not say what its state and its input are."""
    for name in ('state', 'input'):
        found = getattr(model, name, None)
        if not isinstance(found, Space):
            raise ValueError(f'model: its {name}: expected a Space, got {found!r}')


def default_model(name: str) -> Model:
    """Return the model ``name`` with its default parameters."""
    found = find_model(name)
    return found.build() if isinstance(found, System) else found()
