# SPDX-License-Identifier: Apache-2.0
"""Models, sensors and spaces whose functions are compiled C.

Each call writes its arguments into an array of its own, behind which C puts the results: no state
is shared, so that threads may share the objects.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, LinearizedStep, Model, Sensor, Space
from kalman_ros.core.model import like

from .derived import derive
from .formulas import of_model, of_sensor, of_space
from .free_parameters import Parameters
from .library import load
from .source import source

_address: Callable[[Any], int] = ctypes.addressof
_memory: Callable[[Any], Any] = ctypes.c_char.from_buffer
_POINTER, _NUMBER = ctypes.c_void_p, ctypes.c_double


class NativeModel(Model):
    """What a compiled model computes in C; all else is the model's."""

    arithmetic = 'C'
    _linearized: Callable[[int, float, float, int], int]
    _steps: Callable[[int, int, float, float, int], None]
    _shapes: tuple[tuple[int], tuple[int]]
    _numbers: Array
    _p: int

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise."""
        u = like(u, x)
        if x.shape[:-1] != u.shape[:-1] or (x.shape[-1:], u.shape[-1:]) != self._shapes:
            return super().step(x, u, dt)  # which broadcasts, or says what is wrong
        first = x.size
        last = first + u.size
        v = np.empty(last + first + 1)
        v[:first], v[first:last] = x.ravel(), u.ravel()
        count = first // x.shape[-1]
        self._steps(_address(_memory(v)), count, dt, self.max_step, self._p)
        return v[last:-1].reshape(x.shape)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q (n, n), what the noise adds in a step of length ``dt`` from x (n,)."""
        return self.linearized_step(x, u, dt).Q

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state after a step from x (n,) with u (m,), with the step's F and Q."""
        if (x.shape, u.shape) != self._shapes:
            return super().linearized_step(x, u, dt)
        n, moved = x.size, x.size + u.size
        F, Q = moved + n, moved + n + n * n
        v = np.empty(Q + n * n)
        v[:n], v[n:moved] = x, u
        if self._linearized(_address(_memory(v)), dt, self.max_step, self._p):
            return super().linearized_step(x, u, dt)  # which finds out what is wrong
        return LinearizedStep(v[moved:F], v[F:Q].reshape(n, n), v[Q:].reshape(n, n).T)


class NativeSensor(Sensor):
    """What a compiled sensor computes in C; all else is the sensor's."""

    arithmetic = 'C'
    _readings: Callable[[int, int, int], None]
    _slope: Callable[[int, int], None]
    _size: int
    _numbers: Array
    _p: int

    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""
        n, k = self._size, self.output.size
        if x.shape[-1] != n:
            return super().measure(x)  # type: ignore[safe-super]
        size, count = x.size, x.size // n
        v = np.empty(size + count * k + 1)
        v[:size] = x.ravel()
        self._readings(_address(_memory(v)), count, self._p)
        found: Array = v[size:-1].reshape(*x.shape[:-1], k)
        return found

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (k, n) at ``x`` (n,)."""
        n, k = self._size, self.output.size
        if x.shape != (n,):
            return super().jacobian(x)
        v = np.empty(n + n * k)
        v[:n] = x
        self._slope(_address(_memory(v)), self._p)
        H: Array = v[n:].reshape(n, k).T
        return H


class NativeSpace(Space):
    """A space with rotations whose differences are compiled, equal to the same one without."""

    _arrive: Callable[[int], None]
    _subtract: Callable[[int], None]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Space) and _fields(self) == _fields(other)

    __hash__ = Space.__hash__

    def arrived(self, total: Array, origin: Array, P: Array) -> tuple[Array, Array]:
        """Return mean and covariance of an error that moves its origin to its own mean."""
        n = self.size
        if not (n,) == total.shape == origin.shape == P.shape[1:] or P.shape[0] != n:
            return super().arrived(total, origin, P)
        mean, end = 2 * n + n * n, 3 * n + n * n
        v = np.empty(end + n * n)
        v[:n], v[n : 2 * n], v[2 * n : mean] = total, origin, P.ravel()
        self._arrive(_address(_memory(v)))
        return v[mean:end], v[end:].reshape(n, n)

    def subtract(self, a: Array, b: Array) -> Array:
        """Return the shortest difference ``a - b`` (..., n); of rotations, Log(Exp(a) Exp(-b))."""
        n = self.size
        if not (n,) == a.shape == b.shape:
            return super().subtract(a, b)
        v = np.empty(3 * n)
        v[:n], v[n : 2 * n] = a, b
        self._subtract(_address(_memory(v)))
        return v[2 * n :]


def _fields(space: Space) -> tuple[Any, ...]:
    return space.names, space.units, space.angles, space.rotations


def native_model(model: Model, *, wait: bool = True) -> Model:
    """Return a model in continuous time whose steps are compiled.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    CompilerError
        If it cannot be compiled, or without ``wait`` is not yet.
    """
    parameters = Parameters(model)
    library = load(_model_source(parameters), wait=wait)
    library.linearized_step.argtypes = [_POINTER, _NUMBER, _NUMBER, _POINTER]
    library.linearized_step.restype = ctypes.c_int
    library.steps.argtypes = [_POINTER, ctypes.c_long, _NUMBER, _NUMBER, _POINTER]
    library.steps.restype = None
    found: Model = derive(
        NativeModel,
        model,
        native_model,
        state=native_space(model.state, wait=wait),
        _linearized=library.linearized_step,
        _steps=library.steps,
        _shapes=((model.state.size,), (model.input.size,)),
        **_pointed(parameters.values),
    )
    return found


def native_sensor(sensor: Sensor, state: Space, *, wait: bool = True) -> Sensor:
    """Return a sensor of states in a space whose reading and Jacobian are compiled.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    CompilerError
        If it cannot be compiled, or without ``wait`` is not yet.
    """
    parameters = Parameters(sensor)
    library = load(_sensor_source(parameters, state), wait=wait)
    library.readings.argtypes = [_POINTER, ctypes.c_long, _POINTER]
    library.slope.argtypes = [_POINTER, _POINTER]
    library.readings.restype = library.slope.restype = None
    found: Sensor = derive(
        NativeSensor,
        sensor,
        native_sensor,
        state,
        output=native_space(sensor.output, wait=wait),
        _readings=library.readings,
        _slope=library.slope,
        _size=state.size,
        **_pointed(parameters.values),
    )
    return found


def native_space(space: Space, *, wait: bool = True) -> Space:
    """Return a space with compiled differences; one without rotations is as fast as it is."""
    if not space.rotations or isinstance(space, NativeSpace):
        return space
    library = load(_space_source(space), wait=wait)
    for function in (library.arrive, library.subtract):
        function.argtypes, function.restype = [_POINTER], None
    found: Space = derive(
        NativeSpace, space, native_space, _arrive=library.arrive, _subtract=library.subtract
    )
    return found


@lru_cache(maxsize=32)
def _model_source(parameters: Parameters) -> str:
    model: Any = parameters.original
    formulas = of_model(model, parameters)
    constants = {'N': model.state.size, 'M': model.input.size, 'MOST_SUBSTEPS': formulas.most}
    sparse = {'A': formulas.jacobian, 'W': formulas.density}
    if formulas.slope is not None:
        constants['SLOPE'], sparse['F'] = 1, formulas.slope
    return source('step.c', constants, formulas.traces, sparse)


@lru_cache(maxsize=64)
def _sensor_source(parameters: Parameters, state: Space) -> str:
    sensor: Any = parameters.original
    formulas = of_sensor(sensor, state, parameters)
    sizes = {'N': state.size, 'K': sensor.output.size}
    return source('sensor.c', sizes, formulas._asdict(), {'H': formulas.jacobian})


@lru_cache(maxsize=32)
def _space_source(space: Space) -> str:
    return source('space.c', {'N': space.size}, of_space(space)._asdict(), {})


def _pointed(numbers: Array) -> dict[str, Any]:
    """Return numbers, kept in memory, and their address."""
    kept = np.append(numbers, 0.0)  # none have no address
    return {'_numbers': kept, '_p': _address(_memory(kept))}
