# SPDX-License-Identifier: Apache-2.0
"""From named values, as a parameter file has them, to the objects of one scenario.

The same values serve every node, the harness and runs without ROS, so all of them speak of the
same system.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros import sensors
from kalman_ros.core import (
    Gaussian,
    Model,
    Option,
    Signal,
    TimedSensor,
    Value,
    ratio,
    refuse_unknown,
    variances,
    vector,
)
from kalman_ros.estimators import FILTERS

from .declarations import model_of, options, sensor_names
from .model_checks import check_attributes, check_model, check_sensor
from .parameter_files import section
from .scenario import Scenario, SensorSource
from .wiring import system as system_of

#: Where the covariance of a reading may be taken from.
POLICIES = ('message', 'configuration', 'larger')


def complete(values: Mapping[str, Any], known: Mapping[str, Option]) -> dict[str, Value]:
    """Return a value for every known option: the given one, checked, or its default."""
    return {
        name: option.check(values[name]) if name in values else option.default
        for name, option in known.items()
    }


def build(values: Mapping[str, Any], *, with_law: bool = True) -> Scenario:
    """Return the scenario of ``values``; what is not given has its default.

    Without its control law it is one that nobody controls: no law, and no cost.

    Names that a scenario does not know are passed over: they may be a node's own.

    Raises
    ------
    ValueError
        If anything is wrong, with the name of the option at fault.
    """
    full: dict[str, Any] = complete(values, options(values, with_law=with_law))
    refuse_unknown([full['filter']], FILTERS, 'filter')
    system = system_of(full['model'])
    model = model_of(system, section(full, 'model_parameters'))
    rate = full['rate']
    n, m = model.state.size, model.input.size
    mean = vector('initial_estimate', full['initial_estimate'], n)
    sources = {
        name: _source(name, section(full, name), model, rate)
        for name in sensor_names(full['sensors'])
    }
    check_model(model, mean)
    for name, source in sources.items():
        check_sensor(name, source.sensor, mean)
    return Scenario(
        model=model,
        sensors=sources,
        state=_signal('state', section(full, 'state'), n),
        input=_signal('input', section(full, 'input'), m) if m else system.input,
        rate=rate,
        initial_state=vector('initial_state', full['initial_state'], n),
        initial_belief=Gaussian(
            mean, variances('initial_std', full['initial_std'], n, exact=True)
        ),
        filter=full['filter'],
        **(_law(full, n, m) if with_law and m else _no_law(n, m)),
    )


def _law(values: Mapping[str, Any], n: int, m: int) -> dict[str, Any]:
    from . import law

    return law.build(values, n, m)


def _no_law(n: int, m: int) -> dict[str, Any]:
    none = {'state_cost': np.zeros((n, n)), 'input_cost': np.zeros((m, m))}
    return {**none, 'law': '', 'law_options': {}}


def _source(name: str, given: dict[str, Any], model: Model, loop_rate: float) -> SensorSource:
    own = {key: given.pop(key) for key in ('kind', 'noise', 'rate', 'enabled')}
    policy = given.pop('covariance_from')
    reliable, gate = given.pop('reliable'), given.pop('gate')
    wire = {key: given.pop(key) for key in ('topic', 'type', 'fields', 'covariance')}
    try:
        if policy not in POLICIES:
            raise ValueError(f"covariance_from: expected {', '.join(POLICIES)}, got '{policy}'")
        sensor = sensors.build(own['kind'], model.state, own['noise'], given)
        check_attributes(sensor)
        sensor.name = name
        ratio(own['rate'], loop_rate)
        timed = TimedSensor(sensor, own['rate'], own['enabled'])
    except ValueError as error:
        raise ValueError(f'{name}.{error}') from None
    signal = _signal(name, wire, sensor.output.size)
    return SensorSource(timed, signal, policy, reliable, gate)


def _signal(name: str, given: Mapping[str, Any], size: int) -> Signal:
    signal = Signal(**{**given, 'fields': tuple(given['fields'])})
    if len(signal.fields) != size:
        raise ValueError(f'{name}.fields: expected {size} fields, got {len(signal.fields)}')
    return signal
