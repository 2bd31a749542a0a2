# SPDX-License-Identifier: Apache-2.0
"""One plant a file. The file's name is the model's name, and its ``SYSTEM`` is what it offers."""

from __future__ import annotations

from collections.abc import Callable

from kalman_ros.core import LinearSystem, Model, Signal, Space, System, find
from kalman_ros.core.registry import builds
from kalman_ros.core.registry import names as _names

#: What the nodes run when they are told nothing.
DEFAULT = 'mass_spring_damper_2d'


def names() -> list[str]:
    """Return the names of the built-in models."""
    return _names(__name__)


def system(name: str) -> System:
    """Return the system of ``name``: what a built-in model registers, or one's own.

    ``package.module:Name`` may name a `System`, a subclass of `Model`, or a function that is
    annotated to return one; the last two are wired by the names of their states and inputs.
    Nothing else is called.

    Raises
    ------
    ValueError
        If there is none, or it is none of the three.
    """
    found = find('model', name, __name__, 'SYSTEM')
    if isinstance(found, System):
        return found
    if not builds(found, Model):
        raise ValueError(
            f"model: '{name}' is not a System, a Model class or a function annotated '-> Model'"
        )
    try:
        model = found()
    except TypeError as error:
        raise ValueError(f"model: '{name}' cannot be built without arguments: {error}") from None
    if not isinstance(model, Model):
        raise ValueError(f"model: '{name}' gives a {type(model).__name__}, not a Model")
    check_spaces(model)
    return by_name(found, model)


def check_spaces(model: Model) -> None:
    """Raise ValueError if a model does not say what its state and its input are."""
    for name in ('state', 'input'):
        found = getattr(model, name, None)
        if not isinstance(found, Space):
            raise ValueError(f'model: its {name}: expected a Space, got {found!r}')


def by_name(build: Callable[..., Model], model: Model) -> System:
    """Return the wiring of a model by the names of its states and inputs, without sensors.

    States go by ``sensor_msgs/JointState``, inputs by ``std_msgs/Float64MultiArray``; costs and
    initial deviations are ones.
    """
    n, m = model.state.size, model.input.size
    positions = tuple(f'position[{name}]' for name in model.state.names)
    elements = tuple(f'data[{index}]' for index in range(m))
    return System(
        build=build,
        sensors={},
        state=Signal('estimate', 'sensor_msgs/JointState', positions),
        input=Signal('command', 'std_msgs/Float64MultiArray', elements),
        state_cost=(1.0,) * n,
        input_cost=(1.0,) * m,
        initial_state=(0.0,) * n,
        initial_std=(1.0,) * n,
        filter='kf' if isinstance(model, LinearSystem) else 'ekf',
    )


def default_model(name: str) -> Model:
    """Return the model ``name`` with its default parameters."""
    return system(name).build()
