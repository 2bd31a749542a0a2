# SPDX-License-Identifier: Apache-2.0
"""The default wiring of a model: sensors, topics, fields, cost and first belief.

For a model of this package that is ``config/NAME.yaml``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from kalman_ros import models
from kalman_ros.core import Dynamics, SensorSetup, Signal, Space, System
from kalman_ros.core.system import NO_INPUT

from . import shipped
from .parameter_files import from_file, section


def system(name: str) -> System:
    """Return the system of ``name``: a model of this package, or of the user.

    ``package.module:Name`` may name a `System`, a subclass of `Model`, or a function that is
    annotated to return one; the last two are wired by the names of their states and inputs.
    Nothing else is called.

    Raises
    ------
    ValueError
        If there is none, or it is not one of the three.
    """
    entry = models.find_model(name)
    if isinstance(entry, System):
        return entry
    if ':' not in name:
        return _shipped(name, entry)
    try:
        model = entry()
    except TypeError as error:
        raise ValueError(f"model: '{name}' cannot be built without arguments: {error}") from None
    except ValueError:
        raise
    except Exception as error:  # a user's class may raise anything
        reason = f'{type(error).__name__}: {error}'.partition('\n')[0]
        raise ValueError(f"model: '{name}' cannot be built: {reason}") from error
    if not isinstance(model, Dynamics):
        raise ValueError(f"model: '{name}' gives a {type(model).__name__}, not a Model")
    models.check_spaces(model)
    return by_name(entry, model)


@cache
def _shipped(name: str, build: Callable[..., Dynamics]) -> System:
    """Return the wiring in the section for all nodes of a model's parameter file."""
    values = from_file(shipped.file(name))

    def vector(key: str) -> tuple[float, ...]:
        return tuple(map(float, values.get(key, ())))

    return System(
        build=build,
        sensors={sensor: _sensor(section(values, sensor)) for sensor in values['sensors']},
        state=_signal(section(values, 'state')),
        input=_signal(section(values, 'input')) if 'input.topic' in values else NO_INPUT,
        state_cost=vector('state_cost'),
        input_cost=vector('input_cost'),
        initial_state=vector('initial_state'),
        initial_std=vector('initial_std'),
        initial_estimate=vector('initial_estimate'),
        filter=values.get('filter', 'kf'),
    )


#: The values of a sensor that describe its signal.
_WIRE = {'topic', 'type', 'fields', 'covariance'}


def _sensor(values: dict[str, Any]) -> SensorSetup:
    wire = {key: values.pop(key) for key in _WIRE & values.keys()}
    return SensorSetup(
        kind=values.pop('kind'),
        signal=_signal(wire),
        noise=tuple(map(float, values.pop('noise'))),
        rate=float(values.pop('rate')),
        enabled=values.pop('enabled', True),
        options=values,
    )


def _signal(values: Mapping[str, Any]) -> Signal:
    return Signal(**{**values, 'fields': tuple(values['fields'])})


def by_name(build: Callable[..., Dynamics], model: Dynamics) -> System:
    """Return the wiring of a model by the names of its states and inputs, without sensors.

    States go by ``sensor_msgs/JointState``, inputs by ``std_msgs/Float64MultiArray``; costs and
    initial deviations are ones.
    """
    n, m = model.state.size, model.input.size
    positions = tuple(f'position[{name}]' for name in model.state.names)
    return System(
        build=build,
        sensors={},
        state=Signal('estimate', 'sensor_msgs/JointState', positions),
        input=_input_by_name(model.input),
        state_cost=(1.0,) * n,
        input_cost=(1.0,) * m,
        initial_state=(0.0,) * n,
        initial_std=(1.0,) * n,
        filter='kf' if model.is_linear else 'ekf',
    )


def driven_by_name(system: System, model: Dynamics) -> System:
    """Return a system with the input of a model that its parameters give another input."""
    n, m = model.state.size, model.input.size
    input = _input_by_name(model.input)
    return replace(system, input=input, state_cost=(1.0,) * n, input_cost=(1.0,) * m)


#: The fields of a ``geometry_msgs/Twist`` for commanded velocities of a body.
_COMMANDS = {
    'v': 'linear.x', 'vx': 'linear.x', 'vy': 'linear.y', 'omega': 'angular.z', 'wz': 'angular.z',
}  # fmt: skip


def _input_by_name(input: Space) -> Signal:
    """Return the signal of an input: ``cmd_vel`` if all of it are velocities of a body."""
    if input.names and _COMMANDS.keys() >= {*input.names}:
        fields = tuple(_COMMANDS[name] for name in input.names)
        return Signal('cmd_vel', 'geometry_msgs/Twist', fields)
    elements = tuple(f'data[{index}]' for index in range(input.size))
    return Signal('command', 'std_msgs/Float64MultiArray', elements)
