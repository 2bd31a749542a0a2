# SPDX-License-Identifier: Apache-2.0
"""The options of a scenario, which depend on its model, its sensors and their kinds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf, pi
from typing import Annotated, Any

from kalman_ros import models, sensors
from kalman_ros.core import (
    About,
    Model,
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


#: The farthest from the centre of a body that a sensor is, in m.
_FARTHEST = 1e4
#: The feature of turned and displaced sensors, and of the frames of messages.
_FRAMES = 'frames'
#: That of sensors that are late, or read too much or too little.
_CORRECTED = 'corrections'
#: That of readings of zero, and of those at rest.
_STILL = 'stand-still'


#: The options of axes and frames, of a sensor or of the input.
_AXES: Mapping[str, tuple[Value, About]] = {
    'mount.rotation': (
        [0.0, 0.0, 0.0],
        About('roll, pitch, yaw on the body', 'rad', -2.0 * pi, 2.0 * pi, feature=_FRAMES),
    ),
    'convention': (
        'enu',
        About("axes of the messages: 'enu', or 'ned' and forward, right, down", feature=_FRAMES),
    ),
    'frame': (
        '',
        About("frame of the messages, others are dropped; '': the first", feature=_FRAMES),
    ),
}


def _sensor_options(name: str, setup: SensorSetup) -> dict[str, Option]:
    signal = setup.signal
    own: dict[str, tuple[Value, About]] = {
        'kind': (setup.kind, About('kind of sensor, or package.module:Class of your own')),
        'noise': (
            list(setup.noise),
            About('standard deviation of each coordinate', live=True),
        ),
        'rate': (setup.rate, About('readings a second', 'Hz', minimum=1e-6, live=True)),
        'enabled': (setup.enabled, About('whether the sensor is used', live=True)),
        'topic': (signal.topic, About('topic of the readings')),
        'type': (signal.type, About('message type of the readings')),
        'fields': (list(signal.fields), About('field of the message for each coordinate')),
        'covariance': (
            signal.covariance,
            About("path of an array in the message; '': by its type"),
        ),
        'covariance_from': (
            'message',
            About(
                "noise from the 'message' if it has one, from the "
                "'configuration', or the 'larger' of both",
                live=True,
            ),
        ),
        'mount.translation': (
            [0.0, 0.0, 0.0],
            About('forward, left, up of the body', 'm', -_FARTHEST, _FARTHEST, feature=_FRAMES),
        ),
        'mount.rotation': _AXES['mount.rotation'],
        'mount.gravity': (
            0.0,
            About(
                'what an accelerometer reads upwards at rest',
                'm/s^2',
                -100.0,
                100.0,
                feature=_FRAMES,
            ),
        ),
        'mount.tf': (
            False,
            About('both by the transform of frame on /tf_static', feature=_FRAMES),
        ),
        'convention': _AXES['convention'],
        'pose': (
            'absolute',
            About("'relative' to its first, or 'differential': a velocity", feature=_FRAMES),
        ),
        'frame': _AXES['frame'],
        'stamp_offset': (
            0.0,
            About(
                'added to the stamps: below 0 for stamps that are late',
                's',
                -10.0,
                10.0,
                feature=_CORRECTED,
            ),
        ),
        'bias_std': (
            [0.0],
            About(
                'standard deviations of an unknown bias, estimated as a state; one for all',
                minimum=0.0,
                feature=_CORRECTED,
            ),
        ),
        'bias_noise': (
            [0.0],
            About(
                'spectral densities, in squared units by s, of its change; one for all',
                minimum=0.0,
                feature=_CORRECTED,
            ),
        ),
        'zero': (
            False,
            About('read zeros in place of the fields: no slip, no speed', feature=_STILL),
        ),
        'still.below': (
            [inf],
            About('read only while still.fields are smaller than this', feature=_STILL),
        ),
        'still.fields': ([''], About("fields of the messages; '': fields", feature=_STILL)),
        'still.duration': (
            0.5,
            About('and have been for this long', 's', 0.0, 3600.0, feature=_STILL),
        ),
        'gate': (
            1.0,
            About(
                'probability that a valid reading passes; 1: no gate',
                minimum=0.5,
                maximum=1.0,
                live=True,
            ),
        ),
        'reliable': (
            False,
            About('subscribe reliably, not best effort'),
        ),
    }
    found = {key: Option(f'{name}.{key}', default, about) for key, (default, about) in own.items()}
    try:
        listed = sensors.options(setup.kind)
    except ValueError as error:
        raise ValueError(f'{name}.{error}') from None
    for option in listed:
        default = setup.options.get(option.name, option.default)
        found[option.name] = Option(f'{name}.{option.name}', default, option.about)
    return {option.name: option for option in found.values()}


def _signal_options(section: str, signal: Signal, meaning: str) -> dict[str, Option]:
    options = (
        Option(f'{section}.topic', signal.topic, About(f'topic of {meaning}')),
        Option(f'{section}.type', signal.type, About(f'message type of {meaning}')),
        Option(
            f'{section}.fields',
            list(signal.fields),
            About(f'field of the message for each coordinate of {meaning}'),
        ),
    )
    return {option.name: option for option in options}


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
    found = {option.name: option for option in (model, listed, filter)}
    found.update({option.name: option for option in options_of(_shared)})
    for option in options_of(system.build, 'model_parameters.'):
        about = About(**{**option.about.__dict__, 'live': True})
        found[option.name] = Option(option.name, option.default, about)
    for name in sensor_names(listed.check(values.get('sensors', listed.default))):
        setup = _setup(system, name, values)
        found.update(_sensor_options(name, setup))
    found.update(_signal_options('state', system.state, 'the estimate, truth and reference'))
    if built.input.size:
        found.update(_signal_options('input', system.input, 'the input'))
        for key, (value, about) in _AXES.items():
            found[f'input.{key}'] = Option(f'input.{key}', value, about)
        if with_law:
            from . import law

            found.update(law.options(system, values))
    vectors = {
        'initial_state': (system.initial_state, 'initial state of the plant'),
        'initial_estimate': (
            system.initial_estimate or built.equilibrium.state.tolist(),
            'mean before the first reading',
        ),
        'initial_std': (system.initial_std, 'initial standard deviations'),
    }
    for name, (default, meaning) in vectors.items():
        found[name] = Option(name, list(default), About(meaning))
    return found


def _either(names: Iterable[str]) -> str:
    """Return names as text, with an "or" before the last."""
    *others, last = names
    return f'{", ".join(others)} or {last}'


def sensor_names(value: Value) -> list[str]:
    """Return the names in a list of sensors, which must be unique."""
    names = [str(name) for name in value if name] if isinstance(value, list) else []
    if len({*names}) < len(names):
        raise ValueError(f'sensors: expected each name once, got ({", ".join(names)})')
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


def _system(values: Mapping[str, Any]) -> tuple[System, Model]:
    """Return the system in use, wired by name where its parameters change states or inputs."""
    model = Option('model', models.DEFAULT, About('name of the model, or package.module:Class'))
    system = system_of(str(model.check(values.get('model', model.default))))
    built = model_of(system, section(values, 'model_parameters'))
    if len(system.state.fields) != built.state.size:
        return by_name(system.build, built), built
    if len(system.input.fields) != built.input.size:
        return driven_by_name(system, built), built
    return system, built


def model_of(system: System, parameters: Mapping[str, Any]) -> Model:
    """Return the model of a system with these parameters.

    Raises
    ------
    ValueError
        If a parameter is wrong, or the model has no equilibrium.
    """
    try:
        model: Model = build_with(system.build, parameters)
    except ValueError as error:
        raise ValueError(f'model_parameters.{error}') from None
    except ArithmeticError:
        raise ValueError('model_parameters: too large or too small to compute with') from None
    except Exception as error:  # a user's class may raise anything
        reason = f'{type(error).__name__}: {error}'.partition('\n')[0]
        raise ValueError(f'model_parameters: the model cannot be built: {reason}') from error
    check_equilibrium(model)
    return model
