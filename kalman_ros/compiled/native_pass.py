# SPDX-License-Identifier: Apache-2.0
"""A whole pass of an extended Kalman filter over ordered data, in C."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Sensor
from kalman_ros.core.ordered_data import FirstSteps, OrderedData, ReadingMatrices, StepMatrices

from .numbered import COUNT, NUMBER, POINTER, function_address, turns

#: Most states of a pass in C, the matrices of which are on the stack.
MOST_STATES = 100


def matrix_numbers(sensor: Sensor, n: int) -> Array:
    """Return H row by row, and what a linear sensor reads at the origin."""
    origin = np.zeros(n)
    return np.concatenate((sensor.jacobian(origin).ravel(), sensor.measure(origin)))


class _Sensor(ctypes.Structure):
    """``struct sensor`` of ``pass.c``."""

    _fields_ = (
        ('sensed', POINTER), ('p', POINTER), ('subtract', POINTER), ('turns', POINTER),
        ('limit', NUMBER), ('k', COUNT), ('y', POINTER), ('R', POINTER),
        *((name, POINTER) for name in ReadingMatrices._fields),
        ('square', POINTER),
    )  # fmt: skip


class _Sequence(ctypes.Structure):
    """``struct sequence`` of ``pass.c``."""

    _fields_ = (
        ('length', COUNT), ('dt', POINTER), ('parts', POINTER), ('input', POINTER),
        ('inputs', POINTER), ('sensor', POINTER), ('sensors', POINTER), ('p', POINTER),
        ('max_step', NUMBER), ('kept', COUNT), ('arrive', POINTER), ('x', POINTER),
        ('P', POINTER),
        ('F', POINTER), ('Q', POINTER), ('predicted', POINTER), ('covariance', POINTER),
        ('fused', POINTER), ('means', POINTER), ('covariances', POINTER),
        ('start', POINTER), ('row', POINTER),
    )  # fmt: skip


def declare(library: Any) -> None:
    """Declare the pass of the library of a model."""
    getattr(library, 'pass').argtypes = [ctypes.POINTER(_Sequence)]
    getattr(library, 'pass').restype = ctypes.c_long


def run(
    model: Any,
    belief: tuple[Array, Array],
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
    belief
        Mean (n,) and covariance (n, n) at the first instant.
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
    try:
        made = _Pass(model, belief, data, parts, sensors, limits, most_read, kept=kept)
    except _NotInCError:
        return None
    if made.count < len(data.time):
        return None
    fused = made.fused
    counts = [int(np.count_nonzero(fused & (data.sensor == s))) for s in range(len(sensors))]
    whole = int(np.count_nonzero(fused)) if kept else 0
    F, Q, predicted, covariance = (array[:whole] for array in made.steps)
    return StepMatrices(
        F, Q, predicted, covariance, made.after, fused,
        [
            ReadingMatrices(*(array[:count] for array in matrices))
            for matrices, count in zip(made.readings, counts)
        ],
    )  # fmt: skip


def run_first(
    model: Any,
    belief: tuple[Array, Array],
    data: OrderedData,
    parts: Any,
    sensors: Sequence[Sensor],
    limits: Sequence[float],
    most_read: int,
) -> FirstSteps | None:
    """Return the steps before a reading beyond its limit, as `run`; None if not possible in C."""
    try:
        made = _Pass(model, belief, data, parts, sensors, limits, most_read, beliefs=True)
    except _NotInCError:
        return None
    count = made.count
    counts = np.bincount(data.sensor[:count] + 1, minlength=len(sensors) + 1)[1:].tolist()
    read = [*zip(made.readings, made.squares, counts)]
    return FirstSteps(
        made.means[:count],
        made.covariances[:count],
        [matrices.innovation[:size] for matrices, _, size in read],
        [matrices.S[:size] for matrices, _, size in read],
        [square[:size] for _, square, size in read],
    )


class _NotInCError(Exception):
    """A pass is not possible in C."""


class _Pass:
    """A pass over ordered data, with the arrays into which it writes.

    Raises
    ------
    _NotInCError
        If it is not possible.
    """

    def __init__(
        self,
        model: Any,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
        most_read: int,
        *,
        kept: bool = False,
        beliefs: bool = False,
    ) -> None:
        (x, P), length, space = belief, len(data.time), model.state
        n, arrive = x.size, function_address(getattr(space, '_c_arrive', None))
        if n > MOST_STATES or (space.rotations and not arrive):
            raise _NotInCError
        if data.inputs.shape[1:] != model._c_shapes[1]:
            raise _NotInCError
        memory, structures = _Memory(), (_Sensor * len(sensors))()
        self.readings, self.squares = [], []
        counts = np.bincount(data.sensor + 1, minlength=len(sensors) + 1)[1:].tolist()
        for structure, sensor, y, R, limit, count in zip(
            structures, sensors, data.readings, data.covariances, limits, counts
        ):
            if y.shape[1] > most_read or (beliefs and not _exact(sensor, n)):
                raise _NotInCError
            self.readings.append(_fill(structure, memory, sensor, y, R, n, count, kept))
            structure.limit = limit
            if beliefs:
                self.squares.append(np.empty(count))
                structure.square = self.squares[-1].ctypes.data
        # one more, for a step to a reading that is not fused
        whole = 1 + (int(np.count_nonzero(data.sensor >= 0)) if kept else 0)
        F, Q, covariance = np.empty((3, whole, n, n))
        self.steps = F, Q, np.empty((whole, n)), covariance
        self.fused, self.after = np.zeros(length, dtype=bool), (x.copy(), P.copy())
        size = length if beliefs else 0
        self.means, self.covariances = np.empty((size, n)), np.empty((size, n, n))
        at = memory.at
        more: tuple[int, ...] = ()
        if beliefs:
            steps = at(data.start, ctypes.c_long), at(data.row, ctypes.c_long)
            more = self.means.ctypes.data, self.covariances.ctypes.data, *steps
        sequence = _Sequence(
            length, at(data.dt), at(parts, ctypes.c_long), at(data.input, ctypes.c_long),
            at(data.inputs), at(data.sensor, ctypes.c_long), ctypes.addressof(structures),
            model._c_p, model.max_step, kept, arrive,
            *(array.ctypes.data for array in (*self.after, *self.steps, self.fused)),
            *more,
        )  # fmt: skip
        #: The number of instants that were processed.
        self.count = int(getattr(model._c_library, 'pass')(ctypes.byref(sequence)))


class _Memory:
    """Arrays that C reads, which live as long as this."""

    def __init__(self) -> None:
        self._arrays: list[Any] = []

    def at(self, values: Any, kind: Any = np.float64) -> int:
        """Return the address of numbers, of a copy unless they are contiguous and of a kind."""
        self._arrays.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._arrays[-1].ctypes.data)


def _fill(
    structure: _Sensor,
    memory: _Memory,
    sensor: Any,
    y: Array,
    R: Array,
    n: int,
    count: int,
    kept: bool,
) -> ReadingMatrices:
    """Fill in the structure of a sensor, and return the matrices of ``count`` readings."""
    k = y.shape[1]
    functions = _functions(sensor, n) if k == sensor.output.size else None
    if functions is None:
        raise _NotInCError
    more = count if kept else 1  # matrices that are not kept need room for one
    matrices = ReadingMatrices(
        np.empty((more, k, n)), np.empty((more, n, k)), np.empty((count, k, k)),
        np.empty((count, k)), np.empty((more, k, k)), np.empty(more), np.empty((more, k)),
    )  # fmt: skip
    structure.sensed, structure.subtract, numbers = functions
    structure.p = numbers if isinstance(numbers, int) else memory.at(numbers)
    structure.turns, structure.k = memory.at(turns(sensor.output)), k
    structure.y, structure.R = memory.at(y), memory.at(R)
    for name, values in matrices._asdict().items():
        setattr(structure, name, values.ctypes.data)
    return matrices


def _exact(sensor: Any, n: int) -> bool:
    """Return whether C reads a sensor to the bit as it is read one by one.

    Sums of products are rounded in another order there, unless there are two whole states at most.
    """
    if getattr(sensor, '_c_sets', 0) == 1:
        return True
    rest = np.zeros(n)
    H = sensor.jacobian(rest)
    count, whole = np.count_nonzero(H, axis=1), np.isin(H, (-1.0, 0.0, 1.0)).all(axis=1)
    return bool(((count <= 1) | (whole & (count <= 2))).all()) and not sensor.measure(rest).any()


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
        sensed, numbers, *_ = sensor._c_reads
        return sensed, subtract, numbers
    if sensor.linear and not output.rotations:
        return 0, 0, matrix_numbers(sensor, n)
    return None
