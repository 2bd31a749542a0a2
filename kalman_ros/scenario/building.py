# SPDX-License-Identifier: Apache-2.0
"""Builds the objects of a scenario from named values, as in a parameter file.

Every node, the harness and runs without ROS use the same values, so they all describe the same
system.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros import sensors
from kalman_ros.core import (
    Array,
    Dynamics,
    Gaussian,
    Option,
    Sensor,
    Signal,
    TimedSensor,
    Value,
    check_period,
    check_rate,
    ratio,
    refuse_unknown,
    variances,
    vector,
)
from kalman_ros.core.geodesy import Place, datum
from kalman_ros.core.mount import mounting
from kalman_ros.core.quantity import ATTITUDE, quantity
from kalman_ros.core.still import stand_still
from kalman_ros.estimators import FILTERS, filter_options

from .bias_states import bias
from .body_roles import body_of
from .declarations import model_of, options, sensor_names
from .input_place import at_centre
from .lever_arm import LeverArm
from .model_checks import check_attributes, check_model, check_sensor
from .parameter_files import by_section, section
from .scenario import Scenario, SensorSource
from .wiring import system as system_of

#: How a pose is read.
POSES = ('absolute', 'relative', 'differential')
_FIX = 'sensor_msgs/NavSatFix'
#: The allowed sources of a reading's covariance.
POLICIES = ('message', 'configuration', 'larger')


def complete(values: Mapping[str, Any], known: Mapping[str, Option]) -> dict[str, Value]:
    """Return a value for every known option: the given one, checked, or its default."""
    return {
        name: option.check(values[name]) if name in values else option.default
        for name, option in known.items()
    }


def build(values: Mapping[str, Any], *, with_law: bool = True) -> Scenario:
    """Return the scenario of ``values``; missing values have their defaults.

    Without a control law it has neither law nor cost. Unknown names are ignored: they may belong
    to a node.

    Raises
    ------
    ValueError
        If a value is invalid; the message names its option.
    """
    built = assemble(complete(values, options(values, with_law=with_law)), with_law=with_law)
    known = {option.name: option for option in filter_options(built.filter)}
    chosen = {name: known[name].check(values[name]) for name in known if name in values}
    return replace(built, filter_options=chosen) if chosen else built


def assemble(full: Mapping[str, Any], *, with_law: bool = True) -> Scenario:
    """Return the scenario of a value for each of its `options`, as `complete` returns them."""
    refuse_unknown([full['filter']], FILTERS, 'filter')
    system = system_of(full['model'])
    parts = by_section(full)
    model = model_of(system, parts.get('model_parameters', {}))
    rate = full['rate']
    if model.is_discrete:
        check_period(model)
    check_rate(model, rate)
    n, m = model.state.size, model.input.size
    mean = vector('initial_estimate', full['initial_estimate'], n)
    origin, state = datum(full['datum']), _signal('state', parts.get('state', {}), n)
    sources = {
        name: _source(name, parts.get(name, {}), model, rate, state, origin)
        for name in sensor_names(full['sensors'])
    }
    check_model(model, mean)
    for name, source in sources.items():
        check_sensor(name, source.sensor, mean)
    input = _input(parts.get('input', {}), m, model.input_scale) if m else system.input
    _check_topics(sources, {'state': state, **({'input': input} if m else {})})
    return Scenario(
        model=model,
        sensors=sources,
        state=state,
        input=input,
        rate=rate,
        initial_state=vector('initial_state', full['initial_state'], n),
        initial_belief=Gaussian(
            mean,
            # a loop has no theory of a start from nothing
            variances('initial_std', full['initial_std'], n, exact=True, unknown=not with_law),
        ),
        filter=full['filter'],
        datum=origin,
        **(_law(full, n, m) if with_law and m else _no_law(n, m)),
    )


def _check_topics(sources: Mapping[str, SensorSource], others: Mapping[str, Signal]) -> None:
    """Raise ValueError if the messages of one topic are to have two types."""
    signals = {name: source.signal for name, source in sources.items() if source.timed.enabled}
    first: dict[str, tuple[str, str]] = {}
    for name, signal in {**others, **signals}.items():
        type = signal.type.replace('/msg/', '/')
        other, known = first.setdefault(signal.topic, (name, type))
        if type != known:
            raise ValueError(
                f"{name}.type: expected {known} on '{signal.topic}', as of {other}, got {type}"
            )


def rebuild(built: Scenario, full: Mapping[str, Any], changed: Iterable[str]) -> Scenario:
    """Return the scenario that `assemble` would, given that of before and what has ``changed``.

    Of a change of a sensor only that sensor is rebuilt: a whole scenario takes longer than a step
    of a fast loop. Without a change the scenario is the same object.
    """
    names = {name.partition('.')[0] for name in changed}
    if not names:
        return built
    if not names <= built.sensors.keys():
        try:
            scenario = assemble(full, with_law=bool(built.law))
        except (ValueError, LookupError):
            _check_input(
                model_of(system_of(full['model']), section(full, 'model_parameters')), built
            )
            raise
        _check_input(scenario.model, built)
        return scenario
    sources = dict(built.sensors)
    for name in names:
        given = section(full, name)
        sources[name] = _source(name, given, built.model, built.rate, built.state, built.datum)
        check_sensor(name, sources[name].sensor, built.initial_belief.mean)
    return replace(built, sensors=sources)


def _check_input(model: Dynamics, built: Scenario) -> None:
    """Raise ValueError if a changed model has another input, which has no topic."""
    if model.input.size != built.model.input.size:
        size = f'{built.model.input.size} inputs, got {model.input.size}'
        raise ValueError(f'model_parameters: expected a model of {size}: restart the node for it')


def _law(values: Mapping[str, Any], n: int, m: int) -> dict[str, Any]:
    from . import law

    return law.build(values, n, m)


def _no_law(n: int, m: int) -> dict[str, Any]:
    none = {'state_cost': np.zeros((n, n)), 'input_cost': np.zeros((m, m))}
    return {**none, 'law': '', 'law_options': {}}


def _source(
    name: str,
    given: dict[str, Any],
    model: Dynamics,
    loop_rate: float,
    state: Signal,
    origin: Place | None,
) -> SensorSource:
    basics = {key: given.pop(key) for key in ('kind', 'noise', 'rate', 'enabled')}
    policy = given.pop('covariance_from')
    reliable, gate = given.pop('reliable'), given.pop('gate')
    soft_gate, adapt = given.pop('soft_gate'), given.pop('adapt')
    wire = {key: given.pop(key) for key in ('topic', 'type', 'fields', 'covariance')}
    arm, gravity = given.pop('mount.translation'), given.pop('mount.gravity')
    rotation, convention = given.pop('mount.rotation'), given.pop('convention')
    heading = given.pop('mount.heading')
    frame, pose, from_tf = given.pop('frame'), given.pop('pose'), given.pop('mount.tf')
    zero, std, density = given.pop('zero'), given.pop('bias_std'), given.pop('bias_noise')
    small, watched = given.pop('still.below'), given.pop('still.fields')
    duration = given.pop('still.duration')
    offset = round(given.pop('stamp_offset') * 1e9)
    try:
        if policy not in POLICIES:
            raise ValueError(f"covariance_from: expected {', '.join(POLICIES)}, got '{policy}'")
        sensor = sensors.build(basics['kind'], model.state, basics['noise'], given)
        check_attributes(sensor)
        if pose not in POSES:
            raise ValueError(f"pose: expected {', '.join(POSES)}, got '{pose}'")
        if pose != POSES[0] and any(arm):
            raise ValueError(f'mount.translation: expected none with pose: {pose}')
        _check_units(sensor, wire['fields'], pose)
        mount = mounting(rotation, convention, frame, arm, from_tf, heading)
        still = stand_still(wire['fields'], small, watched, duration)
        if any(arm) or gravity:
            body = body_of(model.state, state)
            sensor = LeverArm(sensor, body, wire['fields'], arm, gravity)
        sensor.name, sensor.state = name, model.state
        unknown = bias(sensor.output.size, std, density)
        ratio(basics['rate'], loop_rate)
        timed = TimedSensor(sensor, basics['rate'], basics['enabled'])
    except ValueError as error:
        raise ValueError(f'{name}.{error}') from None
    signal = _signal(name, wire, sensor.output.size)
    signal = replace(
        signal, datum=origin, mounting=mount, pose=pose, zero=zero, still=still,
        stamp_offset=offset,
    )  # fmt: skip
    return SensorSource(timed, signal, policy, reliable, gate, unknown, soft_gate, adapt)


def _check_units(sensor: Sensor, fields: Iterable[str], pose: str) -> None:
    """Raise ValueError where a field is known to have another unit than what it measures."""
    for name, unit, field in zip(sensor.output.names, sensor.output.units, fields):
        if pose == 'differential' and unit in ('m', 'rad'):
            expected = 'expected velocities or rates with pose: differential'
            raise ValueError(f'measures: {expected}, got {name} in {unit}')
        if unit == 'm' and field in ('latitude', 'longitude'):
            expected = 'expected east, north or up, in m'
            raise ValueError(f'fields: {expected}, for {name}, got {field}, in degrees')


def _is_turn(field: str) -> bool:
    read = quantity(field)
    return read is not None and read.kind is ATTITUDE


def placed(
    name: str, source: SensorSource, state: Signal, frame: str, translation: Array, rotation: Array
) -> SensorSource:
    """Return a sensor of ``mount.tf`` at its place, once that is known.

    Parameters
    ----------
    name, source
        The sensor.
    state
        The signal of the state.
    frame
        That of its messages.
    translation, rotation
        Forward, left and up of the body (3,); roll, pitch and yaw (3,).

    Raises
    ------
    ValueError
        If the state lacks the attitude or the rate that this takes.
    """
    signal, sensor, arm = source.signal, source.sensor, translation.tolist()
    # a fix has no axes, and neither has a pressure
    has_axes = signal.type != _FIX and any(map(quantity, signal.fields))
    angles = rotation.tolist() if has_axes else [0.0] * 3
    reported = signal.mounting
    mount = mounting(angles, reported.convention, frame, arm, heading=reported.heading)
    if signal.pose != POSES[0] and all(map(_is_turn, signal.fields)):
        arm = [0.0] * 3  # a change of the rotation is the same everywhere on the body
    if signal.pose != POSES[0] and any(arm):
        raise ValueError(f'{name}.mount.tf: expected no translation with pose: {signal.pose}')
    if any(arm):
        if isinstance(sensor, LeverArm):
            sensor = sensor.at(arm)
        else:
            body = body_of(sensor.state, state)
            sensor = LeverArm(sensor, body, signal.fields, arm)
            sensor.name, sensor.state = name, source.sensor.state
    signal = replace(signal, mounting=mount)
    return replace(source, timed=replace(source.timed, sensor=sensor), signal=signal)


def _input(given: dict[str, Any], size: int, scale: tuple[float, ...]) -> Signal:
    """Return the signal of the input, whose axes may be turned against the body's."""
    rotation, convention = given.pop('mount.rotation'), given.pop('convention')
    place, frame, from_tf = (given.pop(key) for key in ('mount.translation', 'frame', 'mount.tf'))
    offset = round(given.pop('stamp_offset') * 1e9)
    signal = replace(_signal('input', given, size), stamp_offset=offset)
    try:
        mount = mounting(rotation, convention, frame, place, from_tf)
        signal = replace(signal, mounting=mount.at(place)._replace(scale=scale))
        if any(place) and at_centre(signal) is None:
            listed = ', '.join(signal.fields) or 'none'
            raise ValueError(
                f'mount.translation: expected a velocity or an acceleration among the fields, got '
                f'({listed})'
            )
    except ValueError as error:
        raise ValueError(f'input.{error}') from None
    return signal


def _signal(name: str, given: Mapping[str, Any], size: int) -> Signal:
    signal = Signal(**{**given, 'fields': tuple(given['fields'])})
    if len(signal.fields) != size:
        raise ValueError(f'{name}.fields: expected {size} fields, got {len(signal.fields)}')
    return signal
