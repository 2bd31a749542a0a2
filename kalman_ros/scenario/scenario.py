# SPDX-License-Identifier: Apache-2.0
"""From named values, as a parameter file has them, to the objects of one scenario.

The same values serve every node, the harness and runs without ROS, so all of them speak of the
same system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Annotated, Any

import numpy as np

from kalman_ros import models, sensors
from kalman_ros.control.laws import LAWS, law_options
from kalman_ros.core import (
    About,
    Array,
    Gaussian,
    Model,
    Option,
    Sensor,
    SensorSetup,
    Signal,
    System,
    TimedSensor,
    Value,
    build_with,
    options_of,
    ratio,
    refuse_unknown,
    semidefinite,
    variances,
    vector,
)
from kalman_ros.estimators import FILTERS
from kalman_ros.estimators.filter import Plan
from kalman_ros.simulation import faults

from .checks import (
    check_attributes,
    check_equilibrium,
    check_model,
    check_sensor,
)

POLICIES = ('message', 'configuration', 'larger')


@dataclass(frozen=True)
class SensorSource:
    """A sensor of a scenario with the topic that it is read from."""

    timed: TimedSensor
    signal: Signal
    covariance_from: str
    reliable: bool
    gate: float
    faults: Mapping[str, Value]

    @property
    def sensor(self) -> Sensor:
        """How the state is seen."""
        return self.timed.sensor

    def used(self, carried: Array | None) -> Array | None:
        """Return the covariance (k, k) of a reading; None if the configured one is to be used.

        ``carried`` is the one in its message, None if there is none.
        """
        if carried is None or self.covariance_from == 'configuration':
            return None
        larger = carried.trace() > self.sensor.covariance.trace()
        return carried if self.covariance_from == 'message' or larger else None


@dataclass(frozen=True)
class Scenario:
    """A model, its sensors, its signals and its rate, built and checked as a whole."""

    model: Model
    sensors: Mapping[str, SensorSource]
    state: Signal
    input: Signal
    rate: float
    initial_state: Array
    initial_belief: Gaussian
    state_cost: Array
    input_cost: Array
    filter: str
    law: str
    law_options: Mapping[str, Value]

    @property
    def plan(self) -> Plan:
        """What a filter for this scenario is built for: the model and the sensors that are on."""
        timed = {name: source.timed for name, source in self.enabled.items()}
        return Plan(self.model, timed, self.rate)

    @property
    def enabled(self) -> dict[str, SensorSource]:
        """The sensors that are on."""
        return {name: source for name, source in self.sensors.items() if source.timed.enabled}


def _shared(
    rate: Annotated[
        float, About('steps of the loop a second', 'Hz', minimum=1e-3, maximum=1e4)
    ] = 100.0,
) -> None:
    """Carry the options that do not depend on the model."""


def _sensor_options(name: str, setup: SensorSetup) -> dict[str, Option]:
    signal = setup.signal
    own: dict[str, tuple[Value, About]] = {
        'kind': (setup.kind, About('kind of sensor, or package.module:Class of your own')),
        'noise': (
            list(setup.noise),
            About('standard deviation of each coordinate that it reads', live=True),
        ),
        'rate': (setup.rate, About('readings a second', 'Hz', minimum=1e-6, live=True)),
        'enabled': (setup.enabled, About('whether it is read at all', live=True)),
        'topic': (signal.topic, About('topic of the readings')),
        'type': (signal.type, About('message type of the readings')),
        'fields': (list(signal.fields), About('field of the message for each coordinate')),
        'covariance': (
            signal.covariance,
            About("path of a covariance array in the message; '' for that of the type"),
        ),
        'covariance_from': (
            'message',
            About(
                "noise taken from the 'message' where it carries one, from the "
                "'configuration', or the 'larger' of both",
                live=True,
            ),
        ),
        'gate': (
            1.0,
            About(
                'probability with which a good reading passes its gate; 1 for no gate',
                minimum=0.5,
                maximum=1.0,
                live=True,
            ),
        ),
        'reliable': (
            False,
            About('subscribe reliably; drivers of real sensors often publish best effort'),
        ),
    }
    found = {key: Option(f'{name}.{key}', default, about) for key, (default, about) in own.items()}
    for option in faults.fault_options():
        found[option.name] = Option(f'{name}.{option.name}', option.default, option.about)
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


def options(values: Mapping[str, Any]) -> dict[str, Option]:
    """Return every option of the scenario that ``values`` speaks of, by name.

    Which there are depends on the model, on the list of sensors and on their kinds.

    Raises
    ------
    ValueError
        If the model, a sensor or a kind is unknown.
    """
    model = Option('model', models.DEFAULT, About('name of the model, or package.module:Class'))
    system, built = _system(values)
    listed = Option('sensors', list(system.sensors) or [''], About('names of the sensors'))
    filter = Option('filter', system.filter, About(f'the filter: {", ".join(FILTERS)}'))
    found = {option.name: option for option in (model, listed, filter)}
    found.update({option.name: option for option in options_of(_shared)})
    for option in options_of(system.build, 'model_parameters.'):
        about = About(**{**option.about.__dict__, 'live': True})
        found[option.name] = Option(option.name, option.default, about)
    for name in _names(listed.check(values.get('sensors', listed.default))):
        setup = _setup(system, name, values)
        found.update(_sensor_options(name, setup))
    found.update(_signal_options('state', system.state, 'the estimate, truth and reference'))
    if built.input.size:
        found.update(_signal_options('input', system.input, 'the input'))
        found.update(_law_options(system, values))
    vectors = {
        'initial_state': (system.initial_state, 'state in which the plant starts'),
        'initial_estimate': (
            system.initial_estimate or built.equilibrium.state.tolist(),
            'state that the estimator believes in before the first reading',
        ),
        'initial_std': (system.initial_std, 'standard deviations of that belief'),
    }
    for name, (default, meaning) in vectors.items():
        found[name] = Option(name, list(default), About(meaning))
    return found


def _law_options(system: System, values: Mapping[str, Any]) -> dict[str, Option]:
    law = Option('law', 'lqr', About(f'how the input answers the state: {", ".join(LAWS)}'))
    chosen = str(law.check(values.get(law.name, law.default)))
    found = {option.name: option for option in (law, *law_options(chosen))}
    weights = {
        'state_cost': (system.state_cost, 'weight of the state'),
        'input_cost': (system.input_cost, 'weight of the input'),
    }
    for name, (default, meaning) in weights.items():
        about = About(f'{meaning} in the LQR cost: the diagonal, or all rows', live=True)
        found[name] = Option(name, list(default), about)
    return found


def _names(value: Value) -> list[str]:
    names = [str(name) for name in value if name] if isinstance(value, list) else []
    if len({*names}) < len(names):
        raise ValueError(f'sensors: expected each name once, got ({", ".join(names)})')
    return names


def _setup(system: System, name: str, values: Mapping[str, Any]) -> SensorSetup:
    """Return what is known of a sensor: from the system, or from the values if it is a new one."""
    setup = system.sensors.get(name)
    if setup is None:
        missing = [key for key in ('type', 'fields', 'noise') if f'{name}.{key}' not in values]
        if missing:
            near = get_close_matches(name, system.sensors, n=1)
            hint = f"did you mean '{near[0]}'? " if near else ''
            needs = ', '.join(f'{name}.{key}' for key in missing)
            raise ValueError(f"sensors: unknown sensor '{name}'; {hint}a new one needs {needs}")
        setup = SensorSetup('states', Signal(name, '', ('',)), (1.0,), 10.0)
    kind = str(values.get(f'{name}.kind', setup.kind))
    if kind == setup.kind:
        return setup
    return SensorSetup(kind, setup.signal, setup.noise, setup.rate)


def _system(values: Mapping[str, Any]) -> tuple[System, Model]:
    """Return the system that is spoken of, wired by name if its parameters change its states."""
    model = Option('model', models.DEFAULT, About('name of the model, or package.module:Class'))
    system = models.system(str(model.check(values.get('model', model.default))))
    built = _model(system, _section(values, 'model_parameters'))
    sizes = len(system.state.fields), len(system.input.fields)
    if sizes == (built.state.size, built.input.size):
        return system, built
    return models.by_name(system.build, built), built


def _model(system: System, parameters: Mapping[str, Any]) -> Model:
    try:
        model: Model = build_with(system.build, parameters)
    except ValueError as error:
        raise ValueError(f'model_parameters.{error}') from None
    except ArithmeticError:
        raise ValueError('model_parameters: too large or too small to compute with') from None
    check_equilibrium(model)
    return model


def complete(values: Mapping[str, Any], known: Mapping[str, Option]) -> dict[str, Value]:
    """Return a value for every known option: the given one, checked, or its default."""
    return {
        name: option.check(values[name]) if name in values else option.default
        for name, option in known.items()
    }


def build(values: Mapping[str, Any]) -> Scenario:
    """Return the scenario of ``values``; what is not given has its default.

    Names that a scenario does not know are passed over: they may be a node's own.

    Raises
    ------
    ValueError
        If anything is wrong, with the name of the option at fault.
    """
    full: dict[str, Any] = complete(values, options(values))
    refuse_unknown([full['filter']], FILTERS, 'filter')
    system = models.system(full['model'])
    model = _model(system, _section(full, 'model_parameters'))
    rate = full['rate']
    n, m = model.state.size, model.input.size
    mean = vector('initial_estimate', full['initial_estimate'], n)
    sources = {
        name: _source(name, _section(full, name), model, rate) for name in _names(full['sensors'])
    }
    check_model(model, mean)
    for name, source in sources.items():
        check_sensor(name, source.sensor, mean)
    return Scenario(
        model=model,
        sensors=sources,
        state=_signal('state', _section(full, 'state'), n),
        input=_signal('input', _section(full, 'input'), m) if m else system.input,
        rate=rate,
        initial_state=vector('initial_state', full['initial_state'], n),
        initial_belief=Gaussian(
            mean, variances('initial_std', full['initial_std'], n, exact=True)
        ),
        state_cost=semidefinite('state_cost', full.get('state_cost', np.zeros(n)), n),
        input_cost=semidefinite('input_cost', full.get('input_cost', ()), m, definite=True),
        filter=full['filter'],
        law=full.get('law', ''),
        law_options={o.name: full[o.name] for o in law_options(full['law'])} if m else {},
    )


def _section(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    start = f'{name}.'
    return {key[len(start) :]: value for key, value in values.items() if key.startswith(start)}


def _source(name: str, section: dict[str, Any], model: Model, loop_rate: float) -> SensorSource:
    own = {key: section.pop(key) for key in ('kind', 'noise', 'rate', 'enabled')}
    policy = section.pop('covariance_from')
    reliable, gate = section.pop('reliable'), section.pop('gate')
    wire = {key: section.pop(key) for key in ('topic', 'type', 'fields', 'covariance')}
    wrong = {option.name: section.pop(option.name) for option in faults.fault_options()}
    try:
        if policy not in POLICIES:
            raise ValueError(f"covariance_from: expected {', '.join(POLICIES)}, got '{policy}'")
        sensor = sensors.build(own['kind'], model.state, own['noise'], section)
        check_attributes(sensor)
        sensor.name = name
        ratio(own['rate'], loop_rate)
        timed = TimedSensor(sensor, own['rate'], own['enabled'])
        faults.check(timed, wrong)
    except ValueError as error:
        raise ValueError(f'{name}.{error}') from None
    signal = _signal(name, wire, sensor.output.size)
    return SensorSource(timed, signal, policy, reliable, gate, wrong)


def _signal(name: str, section: Mapping[str, Any], size: int) -> Signal:
    signal = Signal(**{**section, 'fields': tuple(section['fields'])})
    if len(signal.fields) != size:
        raise ValueError(f'{name}.fields: expected {size} fields, got {len(signal.fields)}')
    return signal
