# SPDX-License-Identifier: Apache-2.0
"""Tables of pandas as readings: the index has the times, columns have the names.

They are known by their attributes, so pandas is imported only where a table is returned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalman_ros.core import Array, Sensor


@dataclass(frozen=True)
class Unpacked:
    """Readings and inputs as arrays, with their times, and the labels of an index.

    Parameters
    ----------
    times, readings
        As `filter` takes them; by name if each sensor has its own.
    inputs, input_times
        Likewise.
    labels
        Label of the index by time in seconds; empty without a table.
    """

    times: Any
    readings: Any
    inputs: Any
    input_times: Any
    labels: Mapping[float, Any]


def is_table(value: Any) -> bool:
    """Return whether ``value`` is a Series or a DataFrame."""
    return hasattr(value, 'to_numpy') and hasattr(value, 'index')


def unpack(
    times: Any, readings: Any, inputs: Any, input_times: Any, sensors: Mapping[str, Sensor],
    input_names: tuple[str, ...],
) -> Unpacked:  # fmt: skip
    """Return arrays in place of tables; other arguments are returned as they are.

    Dates become seconds since the first of them in any table.

    Raises
    ------
    ValueError
        If a table has no columns for the sensors, or an index that is no time.
    """
    if is_table(times) and readings is None:
        times, readings = None, times
    by_name = dict(readings) if isinstance(readings, Mapping) else {}
    several = {name: table for name, table in by_name.items() if is_table(table)}
    tables = [*several.values(), *(table for table in (readings, inputs) if is_table(table))]
    if not tables:
        return Unpacked(times, readings, inputs, input_times, {})
    start = _start(tables)
    labels: dict[float, Any] = {}
    if is_table(readings):
        by_name = columns_of(readings, sensors)
        if times is None:
            times = _seconds('readings', readings, start, labels)
    elif several:
        given = times if isinstance(times, Mapping) else dict.fromkeys(by_name, times)
        times = {
            name: _seconds(name, table, start, labels) if name in several else given.get(name)
            for name, table in by_name.items()
        }
        by_name = {
            name: columns_of(table, {name: sensors[name]})[name]
            if name in several and name in sensors else table
            for name, table in by_name.items()
        }  # fmt: skip
    if is_table(inputs):
        if input_times is None:
            input_times = _seconds('inputs', inputs, start, {})
        inputs = _named('inputs', inputs, [(name,) for name in input_names])
    return Unpacked(times, by_name or readings, inputs, input_times, labels)


def columns_of(table: Any, sensors: Mapping[str, Sensor]) -> dict[str, Array]:
    """Return the readings (N, k) of each sensor that has columns.

    A column is called ``gps.x``, or ``x`` if no other sensor has that output, or ``gps`` if the
    sensor has one number. A table of one sensor with other names is taken as it stands if it is
    a Series.
    """
    present = _names(table)
    if len(sensors) == 1 and not hasattr(table, 'columns'):
        return {next(iter(sensors)): np.asarray(table.to_numpy(), dtype=float).reshape(-1, 1)}
    outputs = [name for sensor in sensors.values() for name in sensor.output.names]
    found = {}
    for name, sensor in sensors.items():
        candidates = []
        for output in sensor.output.names:
            alone = outputs.count(output) == 1
            single = len(sensor.output.names) == 1
            candidates.append(
                (f'{name}.{output}', *([output] if alone else []), *([name] if single else []))
            )
        if any(candidate in present for names in candidates for candidate in names):
            found[name] = _named(name, table, candidates)
    if not found:
        wanted = ', '.join(f'{name}.{o}' for name, s in sensors.items() for o in s.output.names)
        raise ValueError(f'readings: expected columns such as {wanted}, got {", ".join(present)}')
    return found


def to_dataframe(labels: Any, columns: Mapping[str, Array], name: str = 'time') -> Any:
    """Return a DataFrame of these columns.

    Raises
    ------
    ModuleNotFoundError
        If pandas is not installed.
    """
    try:
        import pandas  # the only use of it
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            'to_dataframe: pandas is not installed: pip install pandas', name='pandas'
        ) from None
    return pandas.DataFrame(dict(columns), index=pandas.Index(labels, name=name))


def _names(table: Any) -> list[str]:
    if hasattr(table, 'columns'):
        return [_flat(label) for label in table.columns]
    return [_flat(table.name)]


def _flat(label: Any) -> str:
    """Return the name of a column; one of several levels is joined by dots."""
    return '.'.join(map(str, label)) if isinstance(label, tuple) else str(label)


def _named(what: str, table: Any, candidates: list[tuple[str, ...]]) -> Array:
    """Return the first of each column's candidates that the table has, as (N, k)."""
    present = _names(table)
    values = np.asarray(table.to_numpy(), dtype=object).reshape(-1, len(present))
    indices = []
    for names in candidates:
        index = next((present.index(name) for name in names if name in present), None)
        if index is None:
            if len(present) == len(candidates) == 1:
                index = 0
            else:
                wanted = ' or '.join(names)
                raise ValueError(f'{what}: no column {wanted}, got {", ".join(present)}')
        indices.append(index)
    try:
        return values[:, indices].astype(float)
    except (TypeError, ValueError):
        raise ValueError(f'{what}: expected numbers, with NaN for gaps') from None


def _index(table: Any) -> Array:
    """Return the index as numbers, dates or differences of dates; those of a zone as UTC."""
    index = table.index
    if getattr(index, 'tz', None) is not None:
        index = index.tz_convert(None)
    return np.asarray(index.to_numpy())


def _start(tables: list[Any]) -> Any:
    """Return the first date of all tables; None if they have none."""
    dates = [
        index.min() for index in map(_index, tables) if index.dtype.kind == 'M' and len(index)
    ]
    return min(dates, default=None)


def _seconds(what: str, table: Any, start: Any, labels: dict[float, Any]) -> Array:
    """Return the times of a table (N,) in seconds, and add its labels."""
    index = _index(table)
    if index.dtype.kind == 'M':
        index = index - start
    if index.dtype.kind == 'm':
        seconds = np.asarray(index.astype('m8[ns]').astype(np.int64) * 1e-9)
    elif index.dtype.kind in 'iuf':
        seconds = np.asarray(index, dtype=float)
    else:
        raise ValueError(f'{what}: expected an index of times, dates or numbers')
    labels.update(zip(seconds.tolist(), table.index))
    return seconds
