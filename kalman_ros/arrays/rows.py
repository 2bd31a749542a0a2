# SPDX-License-Identifier: Apache-2.0
"""Stamped readings and inputs from arrays: checked, in time order, with gaps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, ArrayLike, Dynamics, Sensor, check_real
from kalman_ros.scenario.model_checks import check_sensor

from .accept import filled, got
from .foreign import is_foreign, read_system
from .problems import continuous_model, discrete_model
from .problems import sensor as make_sensor


@dataclass(frozen=True)
class Rows:
    """Vectors (N, k) at times (N,) as given, and the stamps in whole nanoseconds."""

    time: Array
    stamps: Sequence[int]
    values: Array


class Part(Sensor):
    """Some of the coordinates of a sensor, for a reading with missing values."""

    def __init__(self, whole: Sensor, indices: Sequence[int]) -> None:
        self._whole, self._indices = whole, list(indices)
        self.output = whole.output.select(whole.output.names[i] for i in indices)
        self.covariance = whole.covariance[np.ix_(self._indices, self._indices)]
        self.linear = whole.linear
        self.name = f'{whole.name} without {len(whole.output.names) - len(self._indices)}'

    def measure(self, x: Array) -> Array:
        """Return these coordinates of the reading."""
        return self._whole.measure(x)[..., self._indices]

    def jacobian(self, x: Array) -> Array:
        """Return their rows of the Jacobian."""
        return self._whole.jacobian(x)[self._indices]


def model_of(given: Any, what: str = 'a model') -> Dynamics:
    """Return a model, or that of a pair (system, W) whose system is of another library.

    An error asks for ``what``.

    Raises
    ------
    ValueError
        If it is neither; the message names what is missing.
    """
    if isinstance(given, Dynamics):
        return given
    system, noise = given if isinstance(given, tuple) and len(given) == 2 else (given, None)
    if not is_foreign(system):
        raise ValueError(f'model: expected {what}, got {got(given)}')
    if noise is None:
        raise ValueError(
            f'model: expected a pair (system, W), with the noise that acts on the states, got '
            f'{got(system)} alone'
        )
    read = read_system('model', system)
    if read is not None and read.dt is not None:
        return discrete_model(system, noise)
    return continuous_model(system, noise)


def sensors_of(given: Any, model: Dynamics) -> dict[str, Sensor]:
    """Return sensors by name: from one, several, a mapping, or a pair (H, R).

    Raises
    ------
    ValueError
        If the argument is invalid, names repeat, or a sensor does not fit the model.
    """
    if isinstance(given, Sensor):
        sensors = {given.name or 'y': given}
    elif isinstance(given, Mapping):
        sensors = {str(name): _one(str(name), item) for name, item in given.items()}
    elif isinstance(given, (list, tuple)) and given and all(isinstance(s, Sensor) for s in given):
        names = [sensor.name for sensor in given]
        if '' in names or len(set(names)) < len(names):
            raise ValueError(
                f"sensors: expected distinct names, got {names}; give {{'gps': sensor, ...}}"
            )
        sensors = dict(zip(names, given))
    else:
        sensors = {'y': _one('sensors', given)}
    x = model.equilibrium.state
    for name, item in sensors.items():
        item = sensors[name] = item.of(model.state)
        if item.name != name:
            item = sensors[name] = copy(item)
            item.name = name
        columns = np.shape(item.jacobian(x)) if item.linear else None
        if columns is not None and columns[-1] != x.size:
            raise ValueError(
                f'{name}: expected {x.size} columns of H, one a state, got {columns[-1]}'
            )
        check_sensor(name, item, x)
    return sensors


def _one(name: str, given: Any) -> Sensor:
    if isinstance(given, Sensor):
        return given
    if isinstance(given, (tuple, list)) and len(given) == 2:
        return make_sensor(given[0], given[1], 'y' if name == 'sensors' else name)
    raise ValueError(
        f"{name}: expected a sensor, a pair (H, R), or several as {{'gps': ...}}, got {got(given)}"
    )


def rows_of(name: str, times: Any, values: ArrayLike, size: int, model: Dynamics) -> Rows:
    """Return the rows (N, k) of ``values`` at ``times``; by default one per step of the model.

    Raises
    ------
    ValueError
        If shapes do not match, or a time is not finite.
    """
    check_real(name, values)
    try:
        array = np.array(filled(values), dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f'{name}: expected numbers (N, {size}), with NaN for gaps') from None
    if array.ndim == 3 and array.shape[2] == 1:  # columns, as in filterpy
        array = array[:, :, 0]
    if array.ndim <= 1:
        array = array.reshape((-1, 1) if size == 1 else (1, -1))
    if array.ndim != 2 or array.shape[1] != size:
        raise ValueError(f'{name}: expected shape (N, {size}), got {np.shape(values)}')
    if times is None and model.is_discrete:
        times = np.arange(len(array)) * model.period
    if times is not None and np.ndim(times) == 0 and len(array) > 1:
        raise ValueError(
            f'times: expected one time a row, {len(array)}, got the number {times}; '
            f'for a period dt, np.arange({len(array)}) * dt'
        )
    time = times_of('times', times)
    if len(time) != len(array):
        raise ValueError(f'{name}: expected {len(time)} rows, one a time, got {len(array)}')
    return Rows(time, np.rint(time * 1e9).astype(np.int64).tolist(), array)


def times_of(name: str, times: Any) -> Array:
    """Return times (N,) in seconds, or raise ValueError."""
    check_real(name, times, dates=True)
    try:
        given = np.asarray(times)
        if given.dtype.kind in 'mM':  # dates, or differences of them
            given = given.astype(f'{given.dtype.kind}8[ns]').astype(np.int64) * 1e-9
        time = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        raise ValueError(f'{name}: expected numbers, in seconds') from None
    if times is None:
        raise ValueError(f'{name}: expected times (N,) in seconds, got nothing')
    if time.ndim != 1:
        raise ValueError(f'{name}: expected times (N,) in seconds, got shape {time.shape}')
    if not np.isfinite(time).all():
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise ValueError(f'{name}: expected finite times in seconds, got {time[row]} in row {row}')
    if np.abs(time).max(initial=0.0) > 9e9:
        raise ValueError(
            f'{name}: expected seconds, up to 9e9, got {np.abs(time).max():.3g}: nanoseconds '
            'times 1e-9 are seconds'
        )
    return time


def readings_of(
    times: Any, readings: Any, sensors: Mapping[str, Sensor], model: Dynamics
) -> dict[str, Rows]:
    """Return the rows of each sensor, from arrays by name or one with all columns side by side."""
    sizes = {name: sensor.output.size for name, sensor in sensors.items()}
    if not isinstance(readings, Mapping):
        name = next(iter(sensors)) if len(sensors) == 1 else 'readings'
        whole = rows_of('readings', times, readings, sum(sizes.values()), model)
        if len(sensors) == 1:
            return {name: whole}
        ends = np.cumsum(list(sizes.values()))[:-1]
        parts = np.split(whole.values, ends, axis=1)
        return {n: Rows(whole.time, whole.stamps, p) for n, p in zip(sensors, parts)}
    for name in readings:
        if name not in sensors:
            raise ValueError(
                f"readings: '{name}' is not one of the sensors ({', '.join(sensors)})"
            )
    if isinstance(times, Mapping):
        for name in readings:
            if name not in times:
                raise ValueError(f"times: expected those of '{name}', got ({', '.join(times)})")
    return {
        name: rows_of(name, times[name] if isinstance(times, Mapping) else times, values,
                      sizes[name], model)
        for name, values in readings.items()
    }  # fmt: skip


def parts_of(name: str, sensor: Sensor, rows: Rows) -> Iterator[tuple[int, Sensor, Array]]:
    """Yield the index of each row with any value, its sensor, and the reading.

    The sensor is the whole one or a `Part` of it, always the same one for the same gaps.
    """
    there = np.isfinite(rows.values)
    for rotation in sensor.output.rotations:  # one that is known in part says nothing
        three = sensor.output.indices(rotation)
        there[:, three] = there[:, three].all(axis=1, keepdims=True)
    known: dict[bytes, Sensor] = {}
    for index, (present, y) in enumerate(zip(there, rows.values)):
        if present.all():
            yield index, sensor, y
        elif present.any():
            key = present.tobytes()
            if key not in known:
                known[key] = Part(sensor, np.flatnonzero(present).tolist())
                known[key].name = f'{name} {"".join("01"[int(p)] for p in present)}'
            yield index, known[key], y[present]
