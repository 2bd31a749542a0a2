# SPDX-License-Identifier: Apache-2.0
"""Filtering and smoothing of arrays, by the engine of the estimator node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, overload

import numpy as np

from kalman_ros.compiled.parts import COMPILED, parts
from kalman_ros.core import ArrayLike, Dynamics, TimedSensor, Value
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.estimators import default_filter
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.smoother import smooth as smooth_steps
from kalman_ros.scenario import Scenario

from .accept import belief_of, got, numbers
from .estimates import Estimates
from .passing import Pass, Task
from .rows import Rows, model_of, readings_of, rows_of, sensors_of, times_of
from .scenarios import load
from .tables import is_table, unpack


@overload
def filter(
    model: str | Scenario,
    *,
    times: Any,
    readings: Any = None,
    inputs: ArrayLike | None = None,
    initial: Any = None,
    filter: str = '',
    input_times: ArrayLike | None = None,
    gates: float | Mapping[str, float] | None = None,
    options: Mapping[str, Value] | None = None,
    arithmetic: str = COMPILED,
) -> Estimates: ...


@overload
def filter(
    model: Any,
    sensors: Any,
    times: Any = None,
    readings: Any = None,
    inputs: ArrayLike | None = None,
    *,
    initial: Any,
    filter: str = '',
    input_times: ArrayLike | None = None,
    gates: float | Mapping[str, float] | None = None,
    options: Mapping[str, Value] | None = None,
    arithmetic: str = COMPILED,
) -> Estimates: ...


@knows_arguments(
    x0='initial, with P0: (mean, covariance)',
    P0='initial, with x0: (mean, covariance)',
    y='readings',
    z='readings',
    zs='readings',
    u='inputs',
    us='inputs',
    t='times',
    dt='times',
)
def filter(
    model: Any,
    sensors: Any = None,
    times: Any = None,
    readings: Any = None,
    inputs: ArrayLike | None = None,
    initial: Any = None,
    *,
    filter: str = '',
    input_times: ArrayLike | None = None,
    gates: float | Mapping[str, float] | None = None,
    options: Mapping[str, Value] | None = None,
    arithmetic: str = COMPILED,
) -> Estimates:
    """Return the estimates of a filter from readings: ``filter(model, sensor, times, readings)``.

    Parameters
    ----------
    model
        A model, a pair (system, W) with a system of python-control or scipy.signal and the noise
        on its states, or a scenario or the name of one, which includes sensors and an initial
        belief.
    sensors
        One sensor, several by name ``{'gps': ..., 'imu': ...}``, or a pair (H, R).
    times
        In seconds (N,), in any order, taken to the nanosecond; by name, if each sensor has its
        own. A discrete-time model may omit them: one row per period.
    readings
        (N, k), or (N,) of a sensor with one number; of several sensors by name, or with all
        columns side by side. A number that is NaN or infinite is missing; the rest of its row
        is used. A Series or DataFrame of pandas brings its index as the times, which then are
        not given; its columns are found by name: ``gps.x``, ``x``, or ``gps``.
    inputs
        (N, m), each in effect from its time until the next, or one for all; zero by default.
    initial
        The belief at the first time, before its readings: a `Gaussian`, or a pair of mean and
        covariance, which may be a number or a diagonal; a mapping or a table of pandas by the
        names of the states. A state of which nothing is known has an infinite variance;
        ``'diffuse'``: all of them. A scenario has its own; a model takes one.
    filter
        ``'kf'``, ``'ekf'``, ``'ukf'``, ``'iterated_ekf'``, ``'square_root'``, ``'gaussian_sum'``,
        ``'steady_state'`` or ``'luenberger'``;
        by default the scenario's, or ``'kf'`` if all is linear, else ``'ekf'``.
    input_times
        If inputs have their own times.
    gates
        The probability that a valid reading passes, such as 0.999, for all sensors or by
        name; others are rejected, and counted.
    options
        Of the filter: ``{'alpha': 0.5}``.
    arithmetic
        Of models and sensors: ``'compiled'`` where they can be (with CasADi, the extra
        ``kalman_ros[compiled]``, and a C compiler), or ``'numpy'``.

    Raises
    ------
    ValueError
        If an argument is invalid; the message names it.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0.1])
    >>> times, readings = [0, 0.1, 0.2], [0, 0.11, 0.19]
    >>> found = kr.filter(model, ([1, 0], 0.01), times, readings, initial=([0, 1], 0.1))
    >>> found.mean[-1].round(3)
    array([0.199, 0.991])
    """
    if not isinstance(filter, str):
        raise ValueError(f"filter: expected a name such as 'ekf', got {got(filter)}")
    task = _task(model, sensors, initial, filter.lower(), arithmetic)
    if readings is None and not is_table(times):
        raise ValueError(
            'readings: expected rows of numbers, by name if there are several sensors'
        )
    given = unpack(
        times, readings, inputs, input_times, task.sensors, tuple(task.model.input.names),
        discrete=task.model.is_discrete,
    )  # fmt: skip
    rows = readings_of(given.times, given.readings, task.sensors, task.model)
    if not any(len(series.time) for series in rows.values()):
        raise ValueError('readings: expected at least one row, got none')
    acts = _inputs(task.model, given.inputs, given.input_times, given.times, rows)
    last = max(float(read.time.max()) for read in rows.values() if len(read.time))
    if len(acts.time) and acts.time.min() > last:
        raise ValueError(
            f'inputs: expected some before the last reading, at {last:g} s, got the first at '
            f'{acts.time.min():g} s: do they have one clock?'
        )
    if options is None and isinstance(model, (str, Scenario)):
        scenario = load(model)
        options = scenario.filter_options if task.filter == scenario.filter else None
    estimates = Pass(task, rows, acts, gates, options or {}).estimates()
    return replace(estimates, labels=given.labels) if given.labels else estimates


def smooth(estimates: Estimates) -> Estimates:
    """Return the estimates given all readings, later ones included.

    By Rauch, Tung and Striebel; nonlinear models are linearised about the filter's estimates,
    or use its sigma points. Times may be uneven, readings missing.

    Parameters
    ----------
    estimates
        Those of `filter`, whose readings they have.

    Raises
    ------
    ValueError
        If the estimates are not those of `filter` with a kf, ekf or ukf.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0.1])
    >>> times, readings = [0, 0.1, 0.2], [0, 0.11, 0.19]
    >>> found = kr.filter(model, ([1, 0], 0.01), times, readings, initial=([0, 1], 0.1))
    >>> kr.smooth(found).mean[0].round(3)
    array([0.001, 0.992])
    """
    if not isinstance(estimates, Estimates) or estimates.smoothed:
        what = 'smoothed ones' if isinstance(estimates, Estimates) else got(estimates)
        raise ValueError(f'estimates: expected what kr.filter returns, got {what}')
    record = estimates.record
    beliefs = smooth_steps(record.filter, record.steps)
    shown = [beliefs[index] for index in record.shown]
    return replace(
        estimates,
        mean=np.array([belief.mean for belief in shown]),
        covariance=np.array([belief.covariance for belief in shown]),
        nis=np.full(len(shown), np.nan),
        innovations={},
        smoothed=True,
    )


def _task(model: Any, sensors: Any, initial: Any, filter: str, arithmetic: str) -> Task:
    if isinstance(model, (str, Scenario)):
        scenario = load(model)
        model, filter = scenario.model, filter or scenario.filter
        if sensors is None:
            sensors = {name: source.sensor for name, source in scenario.enabled.items()}
        initial = scenario.initial_belief if initial is None else initial
    model = model_of(model, 'a model or a scenario')
    if sensors is None:
        raise ValueError('sensors: expected a sensor, several by name, or a pair (H, R)')
    named = sensors_of(sensors, model)
    if not filter:
        plan = Plan(model, {name: TimedSensor(s, 1.0) for name, s in named.items()}, 1.0)
        filter = default_filter(plan)
    belief, fast = belief_of(initial, model), parts(model, named, arithmetic)
    return Task(fast.model, fast.sensors, belief, filter, fast.arithmetic)


def _inputs(
    model: Dynamics, inputs: Any, input_times: Any, times: Any, rows: Mapping[str, Rows]
) -> Rows:
    """Return the inputs with their stamps; a single one starts with the first reading."""
    m = model.input.size
    if inputs is not None and not m:
        raise ValueError('inputs: expected none, for the model has no input')
    if inputs is None:
        inputs = np.zeros(m)
    array = numbers('inputs', inputs)
    if not np.isfinite(array).all():
        raise ValueError('inputs: expected finite numbers')
    start = min(float(series.time.min()) for series in rows.values() if len(series.time))
    constant = array.ndim == 0 or (array.ndim == 1 and array.size == m and m != 1) or (
        m == 1 and array.size == 1
    )  # fmt: skip
    if constant and input_times is None:
        return rows_of('inputs', [start], array.reshape(1, m), m, model)
    if input_times is None:
        if isinstance(times, Mapping):
            raise ValueError('input_times: expected the times of the inputs, got nothing')
        return rows_of('inputs', next(iter(rows.values())).time, array, m, model)
    return rows_of('inputs', times_of('input_times', input_times), array, m, model)
