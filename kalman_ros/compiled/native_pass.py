# SPDX-License-Identifier: Apache-2.0
"""A whole pass of an extended Kalman filter over ordered data, in C."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Sensor
from kalman_ros.core.ordered_data import OrderedData, ReadingMatrices, StepMatrices

from .native_space import turns
from .numbered import function_address

_POINTER, _LONG, _DOUBLE = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
#: Most states of a pass in C, the matrices of which are on the stack.
MOST_STATES = 100


class _Sensor(ctypes.Structure):
    """``struct sensor`` of ``pass.c``."""

    _fields_ = (
        ('sensed', _POINTER), ('p', _POINTER), ('subtract', _POINTER), ('turns', _POINTER),
        ('limit', _DOUBLE), ('k', _LONG), ('y', _POINTER), ('R', _POINTER),
        *((name, _POINTER) for name in ReadingMatrices._fields),
    )  # fmt: skip


class _Sequence(ctypes.Structure):
    """``struct sequence`` of ``pass.c``."""

    _fields_ = (
        ('length', _LONG), ('dt', _POINTER), ('parts', _POINTER), ('input', _POINTER),
        ('inputs', _POINTER), ('sensor', _POINTER), ('sensors', _POINTER), ('p', _POINTER),
        ('max_step', _DOUBLE), ('kept', _LONG), ('arrive', _POINTER), ('x', _POINTER),
        ('P', _POINTER),
        ('F', _POINTER), ('Q', _POINTER), ('predicted', _POINTER), ('covariance', _POINTER),
        ('fused', _POINTER),
    )  # fmt: skip


def declare(library: Any) -> None:
    """Declare the pass of the library of a model."""
    getattr(library, 'pass').argtypes = [ctypes.POINTER(_Sequence)]
    getattr(library, 'pass').restype = ctypes.c_long


def run(
    model: Any,
    x: Array,
    P: Array,
    data: OrderedData,
    parts: Any,
    sensors: Sequence[Sensor],
    limits: Sequence[float],
    kept: bool,
    most_read: int,
) -> StepMatrices | None:
    """Return the matrices of a pass; None if it is not possible in C, or fails.

    Parameters
    ----------
    model
        A compiled model.
    x, P
        The belief (n,), (n, n) at the first instant.
    data
        Inputs and readings.
    parts
        Parts into which each step is divided (S,).
    sensors, limits
        The sensors, and their largest normalised square of an innovation.
    kept
        Whether more is wanted than innovations, their covariances, and the belief at the end.
    most_read
        Most numbers of a reading.
    """
    n, length, space = x.size, len(data.time), model.state
    arrive = function_address(getattr(space, '_c_arrive', None))
    if n > MOST_STATES or (space.rotations and not arrive):
        return None
    if data.inputs.shape[1:] != model._c_shapes[1]:
        return None
    memory = _Memory()
    structures, outputs = (_Sensor * len(sensors))(), []
    for structure, sensor, y, R, limit in zip(
        structures, sensors, data.readings, data.covariances, limits
    ):
        if y.shape[1] > most_read:
            return None
        matrices = _fill(structure, memory, sensor, y, R, n, kept)
        if matrices is None:
            return None
        structure.limit = limit
        outputs.append(matrices)
    # one more, for a step to a reading that is not fused
    steps = 1 + (int(np.count_nonzero(data.sensor >= 0)) if kept else 0)
    F, Q, covariance = np.empty((3, steps, n, n))
    predicted, fused = np.empty((steps, n)), np.zeros(length, dtype=bool)
    after = x.copy(), P.copy()
    at = memory.at
    sequence = _Sequence(
        length, at(data.dt), at(parts, ctypes.c_long), at(data.input, ctypes.c_long),
        at(data.inputs), at(data.sensor, ctypes.c_long), ctypes.addressof(structures),
        model._c_p, model.max_step, kept, arrive,
        *(array.ctypes.data for array in (*after, F, Q, predicted, covariance, fused)),
    )  # fmt: skip
    if getattr(model._c_library, 'pass')(ctypes.byref(sequence)) < length:
        return None
    counts = [int(np.count_nonzero(fused & (data.sensor == s))) for s in range(len(sensors))]
    whole = int(np.count_nonzero(fused)) if kept else 0
    return StepMatrices(
        F[:whole], Q[:whole], predicted[:whole], covariance[:whole], after, fused,
        [
            ReadingMatrices(*(array[:count] for array in matrices))
            for matrices, count in zip(outputs, counts)
        ],
    )  # fmt: skip


class _Memory:
    """Arrays that C reads, which live as long as this."""

    def __init__(self) -> None:
        self._arrays: list[Any] = []

    def at(self, values: Any, kind: Any = np.float64) -> int:
        """Return the address of numbers, of a copy unless they are contiguous and of a kind."""
        self._arrays.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._arrays[-1].ctypes.data)


def _fill(
    structure: _Sensor, memory: _Memory, sensor: Any, y: Array, R: Array, n: int, kept: bool
) -> ReadingMatrices | None:
    """Fill in the structure of a sensor, and return the matrices that it receives.

    None if the sensor cannot be read in C.
    """
    count, k = y.shape
    functions = _functions(sensor, n) if k == sensor.output.size else None
    if functions is None:
        return None
    more = count if kept else 1  # matrices that are not kept need room for one
    matrices = ReadingMatrices(
        *map(np.empty, ((more, k, n), (more, n, k), (count, k, k))),
        *map(np.empty, ((count, k), (more, k, k), more, (more, k))),
    )
    structure.sensed, structure.subtract, numbers = functions
    structure.p = numbers if isinstance(numbers, int) else memory.at(numbers)
    structure.turns, structure.k = memory.at(turns(sensor.output)), k
    structure.y, structure.R = memory.at(y), memory.at(R)
    for name, values in matrices._asdict().items():
        setattr(structure, name, values.ctypes.data)
    return matrices


def _functions(sensor: Any, n: int) -> tuple[int, int, Any] | None:
    """Return the addresses of a sensor's reading and difference in C, and its numbers.

    A matrix needs none: its numbers are H and what is read at the origin. None if a sensor is
    neither.
    """
    output = sensor.output
    subtract = function_address(getattr(output, '_c_subtract', None))
    if output.rotations and not subtract:
        return None
    if getattr(sensor, '_c_sets', 0) == 1:
        return sensor._c_sensed, subtract, sensor._c_p
    if sensor.linear and not output.rotations:
        rest = np.zeros(n)
        return 0, 0, np.concatenate((sensor.jacobian(rest).ravel(), sensor.measure(rest)))
    return None
