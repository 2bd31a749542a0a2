# SPDX-License-Identifier: Apache-2.0
"""Scenarios from a name, a file, values or objects; no topics are needed."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario
from kalman_ros.control.laws import LAWS
from kalman_ros.control.limiter import LIMITS
from kalman_ros.core import (
    ArrayLike,
    Dynamics,
    Option,
    Signal,
    TimedSensor,
    Value,
    check_rate,
    ratio,
    refuse_unknown,
    vector,
)
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.estimators import FILTERS, default_filter, filter_options
from kalman_ros.estimators.plan import Plan
from kalman_ros.scenario import Scenario, SensorSource, shipped
from kalman_ros.scenario.model_checks import check_model
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation.faults.plant_faults import plant_options

from .accept import belief_of, got, number, weight
from .foreign import is_foreign
from .rows import model_of, sensors_of

#: A sensor object in a program has no topic.
_NOWHERE = Signal('', '', ())
#: The sections of a parameter file to read; later ones override.
BELIEVED = ('estimator', 'controller')


def load(
    given: Scenario | str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | None = None
) -> Scenario:
    """Return a scenario from a name such as ``'cart_pole'``, a parameter file, or parameters.

    Parameters
    ----------
    given
        A name in ``config/``, the path of a YAML file, or a mapping of parameters.
    overrides
        Parameters over those: ``{'joint_states.noise': [0.01, 0.01]}``.

    Raises
    ------
    ValueError
        If the name is unknown, or a parameter is wrong.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.load('cart_pole').model.state.names
    ('x', 'v', 'theta', 'omega')
    """
    if isinstance(given, Scenario):
        if overrides:
            raise ValueError('overrides: expected none for a Scenario, whose objects are built')
        return given
    return scenario.build(values_of(given, {} if overrides is None else overrides, 'plant'))


def values_of(
    given: str | Path | Mapping[str, Any],
    overrides: Mapping[str, Any],
    *nodes: str,
    faults: bool = False,
) -> dict[str, Any]:
    """Return the parameters from a name, a file or a mapping, with ``overrides``.

    Those of the plant's ``faults`` are only known where they have a meaning.

    Raises
    ------
    ValueError
        If there is no such file, or an override is unknown.
    """
    if not isinstance(overrides, Mapping):
        raise ValueError(f'overrides: expected parameters by name, got {got(overrides)}')
    typed, filed = dict(overrides), dict[str, Any]()
    if isinstance(given, Mapping):
        typed = {**given, **overrides}
    elif isinstance(given, (str, Path)):
        filed = from_file(shipped.file(given), *nodes)
    else:
        hint = ''
        if isinstance(given, Dynamics):
            hint = '; kr.make_scenario makes one of a model and sensors'
        elif is_foreign(given) or (isinstance(given, tuple) and given and is_foreign(given[0])):
            hint = '; kr.make_scenario((system, W), sensors, rate=...) makes one'
        if isinstance(given, Scenario):
            hint = ' without parameters to change, as kr.make_scenario returns: give its parts'
        raise ValueError(f'scenario: expected a name or a file, got {got(given)}{hint}')
    values = {**filed, **typed}
    if typed:
        known = plant_options(values) if faults else scenario.options(values)
        of_filter = {option.name for option in filter_options(_filter_of(values, known))}
        refuse_unknown(typed, {*known, *of_filter, *LIMITS, 'idle_input'}, 'parameter')
    return values


def _filter_of(values: Mapping[str, Any], known: Mapping[str, Option]) -> str:
    """Return the name of the filter that parameters choose, or of none that there is."""
    name = str(values.get('filter', known['filter'].default))
    return name if name in FILTERS else FILTERS[0]


@knows_arguments(dt='rate, in Hz', Ts='rate, in Hz', x0='initial_state', P0='initial')
def make_scenario(
    model: Any,
    sensors: Any,
    *,
    rate: float | None = None,
    rates: Mapping[str, float] | None = None,
    initial: Any = None,
    initial_state: ArrayLike | None = None,
    Q: ArrayLike = 1.0,
    R: ArrayLike = 1.0,
    filter: str = '',
    law: str = 'lqr',
    law_options: Mapping[str, Value] | None = None,
) -> Scenario:
    """Return a scenario built from objects, for `design`, `simulate` and `filter`.

    Parameters
    ----------
    model
        The system model, or a pair (system, W) with a system of python-control or scipy.signal
        and the noise on its states.
    sensors
        One sensor, several by name, or a pair (H, R).
    rate
        Steps of the loop per second; for a discrete-time model, one over its period.
    rates
        Readings per second, by sensor; by default the rate of the loop.
    initial
        The initial belief of the estimator: a `Gaussian`, or a pair of mean and covariance; by
        default about the equilibrium with deviations of 1.
    initial_state
        Initial state of the plant (n,); by default the mean of that belief.
    Q, R
        The LQR weights of state and input.
    filter
        By default ``'kf'`` if all is linear, else ``'ekf'``.
    law, law_options
        ``'lqr'``, ``'placement'``, ``'lqi'`` or ``'mpc'``, with options such as
        ``{'tracked': ['x']}``.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> model = kr.continuous_model([[0, 1], [0, 0]], [0, 1], W=[0, 0.1], states='x [m] v [m/s]')
    >>> kr.make_scenario(model, ([1, 0], 0.01), rate=10)
    LinearSystem at 10 Hz, filter kf, law lqr
    states: x [m], v [m/s]
    input: u0
    sensors: y: y at 10 Hz
    initial: mean [0.0, 0.0], std [1.0, 1.0]
    """
    model = model_of(model)
    if rate is None:
        if not model.is_discrete:
            raise ValueError('rate: expected the steps of the loop a second, got nothing')
        rate = 1.0 / model.period
    refuse_unknown([law], LAWS, 'law')
    refuse_unknown([filter or 'kf'], FILTERS, 'filter')
    rate = number('rate', rate)
    if not 0.0 < rate < inf:
        raise ValueError(f'rate: expected a positive number of steps a second, got {rate:g}')
    check_rate(model, rate)
    x, _ = model.equilibrium
    n, m = model.state.size, model.input.size
    belief = belief_of((x, 1.0) if initial is None else initial, model)
    if not model.is_discrete:
        check_model(model, belief.mean)
    sources = {}
    named = sensors_of(sensors, model)
    refuse_unknown(rates or {}, named, 'sensor')
    for name, sensor in named.items():
        sensor_rate = number('rates', (rates or {}).get(name, rate))
        try:
            ratio(sensor_rate, rate)
        except ValueError as error:
            raise ValueError(f'rates: {name}: {error}') from None
        timed = TimedSensor(sensor, sensor_rate)
        sources[name] = SensorSource(timed, _NOWHERE, 'configuration', False, 1.0)
    plan = Plan(model, {n: s.timed for n, s in sources.items()}, rate)
    options = dict(law_options or {})
    return Scenario(
        model=model,
        sensors=sources,
        state=_NOWHERE,
        input=_NOWHERE,
        rate=rate,
        initial_state=vector(
            'initial_state', belief.mean if initial_state is None else initial_state, n
        ),
        initial_belief=belief,
        state_cost=weight('Q', Q, n),
        input_cost=weight('R', R, m, definite=True) if m else np.zeros((0, 0)),
        filter=filter or default_filter(plan),
        law=law if m else '',
        law_options=options if m else {},
    )
