# SPDX-License-Identifier: Apache-2.0
"""Tables of pandas as readings: the index has the times, columns have the names.

They are known by their attributes, so pandas is imported only where a table is returned.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
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
    input_names: tuple[str, ...], *, discrete: bool = False,
) -> Unpacked:  # fmt: skip
    """Return arrays in place of tables; other arguments are returned as they are.

    Dates become seconds since the first of them. The rows of a model in ``discrete`` time may be
    counted.

    Raises
    ------
    ValueError
        If a table has no columns for the sensors, an index that is no time, or times of another
        kind than the others.
    """
    if is_table(times) and readings is None:
        times, readings = None, times
    elif is_table(times) and _kind(times) not in (_COUNT, _NUMBERS):
        raise ValueError('times: got a table with dates as its index: give it as the readings')
    by_name = dict(readings) if isinstance(readings, Mapping) else {}
    several = {name: table for name, table in by_name.items() if is_table(table)}
    tables = {'readings': readings, 'inputs': inputs, **several}
    indexed = {
        name: _Index.of(name, table)
        for name, table in tables.items()
        if is_table(table) and (input_times if name == 'inputs' else times) is None
    }
    if not any(map(is_table, tables.values())):
        return Unpacked(times, readings, inputs, input_times, {})
    given = times if isinstance(times, Mapping) else {'times': times}
    listed = {**given, 'input_times': input_times}
    indexed |= {n: _Index.given(n, times) for n, times in listed.items() if times is not None}
    clock = _Clock(indexed.values(), discrete=discrete)
    if is_table(readings):
        by_name = columns_of(readings, sensors)
        times = clock.seconds(indexed['readings'] if times is None else indexed['times'])
    elif several:
        by_all = indexed.get('times')
        known = {name: indexed.get(name, by_all) for name in by_name}
        times = {name: clock.seconds(index) for name, index in known.items() if index is not None}
        by_name = {
            name: columns_of(table, {name: sensors[name]})[name]
            if name in several and name in sensors else table
            for name, table in by_name.items()
        }  # fmt: skip
    elif times is not None and not isinstance(times, Mapping):
        times = clock.seconds(indexed['times'])
    if is_table(inputs):
        if input_times is None:
            input_times = clock.seconds(indexed['inputs'])
        inputs = _named('inputs', inputs, [(name,) for name in input_names])
    if 'input_times' in indexed:
        input_times = clock.seconds(indexed['input_times'])
    return Unpacked(times, by_name or readings, inputs, input_times, clock.labels)


#: Kinds of times; those of one call must be of one kind.
_COUNT, _NUMBERS, _SPANS = 'a count of rows', 'numbers', 'differences of dates'
_DATES, _ZONED = 'dates', 'dates with a time zone'


@dataclass(frozen=True)
class _Index:
    """Times by their name: numbers, dates (as UTC), or differences of dates; and their labels."""

    name: str
    values: Array
    labels: Any

    @classmethod
    def of(cls, name: str, table: Any) -> _Index:
        """Return the index of a table."""
        return cls.given(name, table.index)

    @classmethod
    def given(cls, name: str, times: Any) -> _Index:
        """Return times that are an index, or an array or a list."""
        plain = times.tz_convert(None) if getattr(times, 'tz', None) is not None else times
        values = np.asarray(plain.to_numpy() if hasattr(plain, 'to_numpy') else plain)
        if values.dtype.kind == 'O' and values.size and hasattr(values.flat[0], 'tzinfo'):
            values = values.astype('datetime64[ns]')
        return cls(name, values, times)

    @property
    def kind(self) -> str:
        """Kind of the times: two kinds in one call cannot be compared."""
        labels, kind = self.labels, self.values.dtype.kind
        if kind == 'M':
            return _DATES if getattr(labels, 'tz', None) is None else _ZONED
        if type(labels).__name__ == 'RangeIndex' and not labels.start and labels.step == 1:
            return _COUNT
        if kind not in 'miuf':
            raise ValueError(
                f'{self.name}: expected an index of times: numbers in seconds, or dates by '
                'pandas.to_datetime'
            )
        return _SPANS if kind == 'm' else _NUMBERS


def _kind(table: Any) -> str:
    return _Index.of('times', table).kind


class _Clock:
    """Seconds of several times of one kind: dates count from the first of all.

    Raises
    ------
    ValueError
        If they are of different kinds, or count rows where time is continuous.
    """

    def __init__(self, indices: Collection[_Index], *, discrete: bool) -> None:
        kinds = {index.name: index.kind for index in indices}
        if _COUNT in kinds.values() and not discrete:
            name = next(name for name, kind in kinds.items() if kind == _COUNT)
            raise ValueError(
                f"{name}: the index of the table counts rows: give times, or set_index('time')"
            )
        if len(set(kinds.values())) > 1:
            listed = ', '.join(f'those of {name} are {kind}' for name, kind in kinds.items())
            raise ValueError(f'times: expected one kind, {listed}')
        #: Label of each time of a table, by its seconds.
        self.labels: dict[float, Any] = {}
        dates = [index.values for index in indices if index.values.dtype.kind == 'M']
        known = [values[~np.isnat(values)] for values in dates]
        self._start: Any = min((values.min() for values in known if values.size), default=None)

    def seconds(self, index: _Index) -> Array | None:
        """Return times (N,) in seconds, and remember their labels; None if rows are counted."""
        if index.kind == _COUNT:
            return None
        values: Any = index.values
        if values.dtype.kind == 'M':
            values = values - self._start
        if values.dtype.kind == 'm':
            spans = values.astype('m8[ns]').astype(np.int64) * 1e-9
            values = np.where(np.isnat(values), np.nan, spans)
        seconds: Array = np.asarray(values, dtype=float)
        if index.name not in ('inputs', 'input_times') and seconds.ndim == 1:
            self.labels.update(zip(seconds.tolist(), index.labels))
        return seconds


def columns_of(table: Any, sensors: Mapping[str, Sensor]) -> dict[str, Array]:
    """Return the readings (N, k) of each sensor that has columns.

    A column is called ``gps.x``, or ``x`` if no other sensor has that output, or ``gps`` if the
    sensor has one number. One column for the only number of the only sensor may have any name.

    Raises
    ------
    ValueError
        If a sensor has no column, or a column is there twice.
    """
    present = _names(table)
    if len(set(present)) < len(present):
        twice = next(name for name in present if present.count(name) > 1)
        raise ValueError(f"readings: the column '{twice}' is there twice")
    only = next(iter(sensors.values())) if len(sensors) == 1 else None
    if only is not None and len(present) == len(only.output.names) == 1:
        return {next(iter(sensors)): _named(next(iter(sensors)), table, [(present[0],)])}
    outputs = [name for sensor in sensors.values() for name in sensor.output.names]
    readings = {}
    for name, sensor in sensors.items():
        candidates = []
        for output in sensor.output.names:
            alone = outputs.count(output) == 1
            single = len(sensor.output.names) == 1
            candidates.append(
                (f'{name}.{output}', *([output] if alone else []), *([name] if single else []))
            )
        if any(candidate in present for names in candidates for candidate in names):
            readings[name] = _named(name, table, candidates)
    if not readings:
        wanted = ', '.join(f'{name}.{o}' for name, s in sensors.items() for o in s.output.names)
        raise ValueError(f'readings: expected columns such as {wanted}, got {", ".join(present)}')
    lost = next((name for name in sensors if name not in readings), '')
    if lost:
        raise ValueError(
            f"readings: no column of '{lost}', got {', '.join(present)}; leave the sensor out if "
            'it read nothing'
        )
    return readings


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
            if len(present) != 1 or len(candidates) != 1:
                wanted = ' or '.join(names)
                raise ValueError(f'{what}: no column {wanted}, got {", ".join(present)}')
            index = 0
        indices.append(index)
    try:
        return values[:, indices].astype(float)
    except (TypeError, ValueError):
        raise ValueError(f'{what}: expected numbers, with NaN for gaps') from None
