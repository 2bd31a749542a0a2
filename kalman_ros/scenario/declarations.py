# SPDX-License-Identifier: Apache-2.0
"""The options of a scenario, which depend on its model, its sensors and their kinds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Annotated, Any

from kalman_ros import models
from kalman_ros.core import (
    About,
    Dynamics,
    Option,
    SensorSetup,
    Signal,
    System,
    Value,
    build_with,
    options_of,
)
from kalman_ros.core.named_options import nearest
from kalman_ros.estimators import FILTERS

from .model_checks import check_equilibrium
from .parameter_files import section
from .signal_declarations import AXES, STAMP_OFFSET, sensor_options, signal_options
from .wiring import by_name, driven_by_name
from .wiring import system as system_of


def _shared(
    rate: Annotated[
        float, About('steps of the loop a second', 'Hz', minimum=1e-3, maximum=1e4)
    ] = 100.0,
    datum: Annotated[
        Sequence[float],
        About('origin: latitude, longitude, altitude; .inf: the first fix', feature='fixes'),
    ] = (inf,),
) -> None:
    """Carry the options that do not depend on the model."""


def options(values: Mapping[str, Any], *, with_law: bool = True) -> dict[str, Option]:
    """Return the options of the scenario that ``values`` describe, by name.

    They depend on the model, on the list of sensors and on their kinds; those of the
    control law can be omitted.

    Raises
    ------
    ValueError
        If the model, a sensor or a kind is unknown.
    """
    model = Option('model', models.DEFAULT, About('name of the model, or package.module:Class'))
    system, built = _system(values)
    listed = Option('sensors', list(system.sensors) or [''], About('names of the sensors'))
    filter = Option('filter', system.filter, About(_either(FILTERS)))
    declared = {option.name: option for option in (model, listed, filter)}
    declared.update({option.name: option for option in options_of(_shared)})
    for option in options_of(system.build, 'model_parameters.'):
        about = About(**{**option.about.__dict__, 'live': True})
        declared[option.name] = Option(option.name, option.default, about)
    for name in sensor_names(listed.check(values.get('sensors', listed.default))):
        setup = _setup(system, name, values)
        declared.update(sensor_options(name, setup))
    declared.update(signal_options('state', system.state, 'the estimate, truth and reference'))
    if built.input.size:
        declared.update(signal_options('input', system.input, 'the input'))
        for key, (value, about) in {**AXES, 'stamp_offset': STAMP_OFFSET}.items():
            declared[f'input.{key}'] = Option(f'input.{key}', value, about)
        if with_law:
            from . import law

            declared.update(law.options(system, built.state, values))
    vectors = {
        'initial_state': (system.initial_state, 'initial state of the simulated plant'),
        'initial_estimate': (
            system.initial_estimate or built.equilibrium.state.tolist(),
            'mean at a start or reset',
        ),
        'initial_std': (system.initial_std, 'initial deviations; .inf: unknown'),
    }
    for name, (default, meaning) in vectors.items():
        declared[name] = Option(name, list(default), About(meaning, live=name != 'initial_state'))
    return declared


def _either(names: Iterable[str]) -> str:
    """Return names as text, with an "or" before the last."""
    *others, last = names
    return f'{", ".join(others)} or {last}'


#: Sections of a parameter file that are no sensors.
_SECTIONS = 'state', 'input', 'model_parameters', 'state_limit'


def sensor_names(value: Value) -> list[str]:
    """Return the names in a list of sensors, which must be unique."""
    names = [str(name) for name in value if name] if isinstance(value, list) else []
    if len({*names}) < len(names):
        raise ValueError(f'sensors: expected each name once, got ({", ".join(names)})')
    for name in names:
        if '.' in name:  # which separates the name of a sensor from that of its option
            raise ValueError(f"sensors: expected names without a dot, got '{name}'")
        if name in _SECTIONS:
            raise ValueError(f"sensors: '{name}' is the name of another section, choose another")
    return names


def _setup(system: System, name: str, values: Mapping[str, Any]) -> SensorSetup:
    """Return the setup of a sensor: from the system, or from the values if it is a new one."""
    setup = system.sensors.get(name)
    if setup is None:
        missing = [key for key in ('type', 'fields', 'noise') if f'{name}.{key}' not in values]
        if missing:
            needs = f'a new one needs {", ".join(f"{name}.{key}" for key in missing)}'
            hint = ' '.join(filter(None, (nearest(name, system.sensors), needs)))
            raise ValueError(f"sensors: unknown sensor '{name}'; {hint}")
        setup = SensorSetup('states', Signal(name, '', ('',)), (1.0,), 10.0)
    kind = str(values.get(f'{name}.kind', setup.kind))
    if kind == setup.kind:
        return setup
    return SensorSetup(kind, setup.signal, setup.noise, setup.rate)


def _system(values: Mapping[str, Any]) -> tuple[System, Dynamics]:
    """Return the system in use, wired by name where its parameters change states or inputs."""
    model = Option('model', models.DEFAULT, About('name of the model, or package.module:Class'))
    system = system_of(str(model.check(values.get('model', model.default))))
    built = model_of(system, section(values, 'model_parameters'))
    if len(system.state.fields) != built.state.size:
        return by_name(system.build, built), built
    if len(system.input.fields) != built.input.size:
        return driven_by_name(system, built), built
    return system, built


def model_of(system: System, parameters: Mapping[str, Any]) -> Dynamics:
    """Return the model of a system with these parameters.

    Raises
    ------
    ValueError
        If a parameter is wrong, or the model has no equilibrium.
    """
    try:
        model: Dynamics = build_with(system.build, parameters)
    except ValueError as error:
        raise ValueError(f'model_parameters.{error}') from None
    except ArithmeticError:
        raise ValueError('model_parameters: too large or too small to compute with') from None
    except Exception as error:  # a user's class may raise anything
        reason = f'{type(error).__name__}: {error}'.partition('\n')[0]
        raise ValueError(f'model_parameters: the model cannot be built: {reason}') from error
    check_equilibrium(model)
    return model
