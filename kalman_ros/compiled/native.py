# SPDX-License-Identifier: Apache-2.0
"""Models, sensors and spaces whose functions are compiled C.

Each call writes its arguments into a new array, behind which C puts the results: no state
is shared, so that threads may share the objects.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, LinearizedStep, Model, Sensor, Space, is_finite
from kalman_ros.core.model import like
from kalman_ros.core.ordered_data import OrderedData, StepMatrices

from .derived import derive
from .formulas import of_model, of_sensor, of_space
from .free_parameters import Parameters, freed
from .library import load
from .native_pass import declare, run
from .source import source

_address: Callable[[Any], int] = ctypes.addressof
_memory: Callable[[Any], Any] = ctypes.c_char.from_buffer
_POINTER, _NUMBER = ctypes.c_void_p, ctypes.c_double
_STEPS = 'series.c', 'flow.c', 'step.c', 'lanes.c', 'series.c', 'members.c', 'pass.c'
#: Most numbers of a reading for which C corrects many members.
MOST_READ = 12


class _Numbered:
    """The numbers of a model or a sensor, for the formulas of its library; or those of several."""

    arithmetic = 'C'
    #: Functions take leading axes.
    takes_leading_axes = True
    _c_library: Any
    _c_numbers: Array
    _c_p: int
    #: How many sets of numbers there are, for as many members in turn, and whose they are.
    _c_sets = 1
    _c_members: Sequence[Any] = ()

    def merged_numbers(self, others: Sequence[Any]) -> Any:
        """Return one object for states (..., p, n) of p objects; None if their formulas differ."""
        every = [self, *others]
        if not all(map(self._c_alike, every)):
            return None
        whole = copy(self)
        sets = [each._c_numbers[:-1] for each in every]
        if any(not np.array_equal(each, sets[0]) for each in sets):
            vars(whole).update(_pointed(np.concatenate(sets)))
            whole._c_sets, whole._c_members = len(every), every
        return whole

    def _c_alike(self, other: Any) -> bool:
        return getattr(other, '_c_library', None) is self._c_library and other._c_sets == 1

    def _c_lost(self, found: Array, part: type) -> Iterator[tuple[int, Any]]:
        """Yield the members whose results (members, ...) are not finite, with their originals.

        The original functions are those behind a ``part`` of the class. An exact derivative may
        not exist where a function that looks at its numbers has one.
        """
        members = self._c_members or [self]
        for k in np.flatnonzero(~np.isfinite(found).all(axis=(*range(1, found.ndim),))).tolist():
            yield k, super(part, members[k % self._c_sets])


class NativeModel(_Numbered, Model):
    """A model whose rates, steps and linearisations are computed in C."""

    _c_shapes: tuple[tuple[int], tuple[int]]

    def _c_alike(self, other: Any) -> bool:
        return super()._c_alike(other) and bool(other.max_step == self.max_step)

    def _c_called(
        self,
        function: Callable[..., Any],
        x: Array,
        u: Array,
        size: int,
        *arguments: float,
        behind: Array | None = None,
    ) -> Array | None:
        """Return ``size`` numbers for each of states (..., n); None if that is not their size.

        ``behind`` x and u may be further numbers.
        """
        if (x.shape[-1:], u.shape[-1:]) != self._c_shapes:
            return None
        if x.shape[:-1] != u.shape[:-1]:
            x, u = (np.broadcast_to(each, (*_lead(x, u), each.shape[-1])) for each in (x, u))
        first, count = x.size, x.size // x.shape[-1]
        middle = first + u.size
        last = middle + (0 if behind is None else behind.size)
        v = np.empty(last + count * size + 1)
        v[:first], v[first:middle] = x.ravel(), u.ravel()
        if behind is not None:
            v[middle:last] = behind.ravel()
        function(_address(_memory(v)), count, *arguments, self._c_p, self._c_sets)
        return v[last:-1]

    def predicted_moments(
        self, x: Array, P: Array, u: Array, dt: float, number: int = 1
    ) -> tuple[Array, Array]:
        """Return means (..., n) and covariances (..., n, n) after linearised steps."""
        if x.ndim == 1 and (number == 1 or (x.shape, u.shape) != self._c_shapes):
            return super().predicted_moments(x, P, u, dt, number)
        n, u = x.shape[-1], like(u, x)
        covariances = np.broadcast_to(P, (*x.shape, n))
        step = self._c_library.predictions
        lengths = dt, self.max_step, number
        found = self._c_called(step, x, u, n + n * n, *lengths, behind=covariances)
        if found is None:
            raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
        mean, covariance = found[: x.size], found[x.size :].reshape(-1, n, n)
        if not is_finite(found) and x.ndim == 1:
            return super().predicted_moments(x, P, u, dt, number)
        if not is_finite(found):
            points, before = x.reshape(-1, n), covariances.reshape(-1, n, n)
            for k, original in self._c_lost(covariance, NativeModel):
                at, C, input = points[k], before[k], u.reshape(len(points), -1)[k]
                for _ in range(number):
                    F, Q = _linearized(original, at, input, dt)
                    at, C = original.step(at, input, dt), F @ C @ F.T + Q
                covariance[k] = C
        return mean.reshape(x.shape), covariance.reshape(covariances.shape)

    def corrected_moments(
        self, x: Array, P: Array, H: Array, R: Array, innovation: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return means and covariances after readings, with K and S, of many members at once."""
        n, lead, k = x.shape[-1], innovation.shape[:-1], innovation.shape[-1]
        if innovation.ndim == 1 or k > MOST_READ or (n,) != self._c_shapes[0]:
            return super().corrected_moments(x, P, H, R, innovation)
        given = (x, (n,)), (P, (n, n)), (H, (k, n)), (R, (k, k)), (innovation, (k,))
        count, at = math.prod(lead), 0
        v = np.empty(count * (2 * (n + n * n + n * k + k * k) + k) + 1)
        for value, shape in given:
            end = at + count * math.prod(shape)
            v[at:end].reshape(*lead, *shape)[...] = value
            at = end
        self._c_library.corrections(_address(_memory(v)), count, k)
        results = []
        for shape in ((n,), (n, n), (n, k), (k, k)):
            end = at + count * math.prod(shape)
            results.append(v[at:end].reshape(*lead, *shape))
            at = end
        mean, covariance, K, S = results
        return mean, covariance, K, S

    def noisy_step(self, x: Array, u: Array, dt: float, normal: Array) -> Array:
        """Return the states (..., n) after a step with the noise of standard normal numbers."""
        found, u = None, like(u, x)
        alike = x.shape == normal.shape and x.shape[:-1] == u.shape[:-1]
        if x.ndim > 1 and alike and not self.state.rotations:
            step, n = self._c_library.noisy_steps, x.shape[-1]
            found = self._c_called(step, x, u, n, dt, self.max_step, behind=normal)
        if found is None or not is_finite(found):
            return super().noisy_step(x, u, dt, normal)
        return found.reshape(x.shape)

    def factor(self, P: Array) -> Array:
        """Return L with L L' = P (..., n, n), NaN where P is not positive definite."""
        (n,) = self._c_shapes[0]
        if P.ndim == 2 or P.shape[-1] != n:
            return super().factor(P)
        v = np.empty(2 * P.size + 1)
        v[: P.size] = P.ravel()
        self._c_library.factors(_address(_memory(v)), P.size // (n * n))
        return v[P.size : -1].reshape(P.shape)

    def filter_pass(
        self,
        belief: tuple[Array, Array],
        data: OrderedData,
        parts: Any,
        sensors: Sequence[Sensor],
        limits: Sequence[float],
        kept: bool = True,
    ) -> StepMatrices | None:
        """Return the matrices of an extended filter that processes data in order."""
        return run(self, *belief, data, parts, sensors, limits, kept, MOST_READ)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""
        found = self._c_called(self._c_library.rates, x, u, x.shape[-1])
        if found is None:
            return super().derivative(x, u)  # type: ignore[safe-super]
        return found.reshape(*_lead(x, u), x.shape[-1])

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise."""
        u, n = like(u, x), x.shape[-1]
        found = self._c_called(self._c_library.steps, x, u, n, dt, self.max_step)
        if found is None:
            return super().step(x, u, dt)  # which says what is wrong
        return found.reshape(*_lead(x, u), n)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q (..., n, n), what the noise adds in a step of length ``dt`` from x (..., n)."""
        return self.step_noise(x, u, dt)

    def step_noise(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q (..., n, n) of `linearized_step`."""
        if x.ndim == 1:
            return self.linearized_step(x, u, dt).Q
        n, u = x.shape[-1], like(u, x)
        found = self._c_called(self._c_library.noises, x, u, n * n, dt)
        if found is None:
            raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
        Q = found.reshape(-1, n, n)
        if not is_finite(found):
            for k, original in self._c_lost(Q, NativeModel):
                Q[k] = _linearized(original, x.reshape(-1, n)[k], u.reshape(len(Q), -1)[k], dt)[1]
        return Q.reshape(*x.shape, n)

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state (..., n) after a step with u (..., m), with the step's F and Q."""
        n = x.shape[-1]
        if x.ndim > 1:
            u = like(u, x)
            step = self._c_library.linearized_steps
            found = self._c_called(step, x, u, n + 2 * n * n, dt, self.max_step)
            if found is None:
                raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
            count, shape = x.size // n, (*x.shape, n)
            both = found[count * n :].reshape(2, count, n, n)
            if not is_finite(found):
                for k, original in self._c_lost(both.swapaxes(0, 1), NativeModel):
                    at = x.reshape(count, n)[k], u.reshape(count, -1)[k]
                    both[:, k] = _linearized(original, *at, dt)
            F, Q = both.reshape(2, *shape)
            return LinearizedStep(found[: count * n].reshape(x.shape), F, Q)
        if (x.shape, u.shape) != self._c_shapes:
            return super().linearized_step(x, u, dt)
        moved = n + u.size
        F, Q = moved + n, moved + n + n * n
        v = np.empty(Q + n * n)
        v[:n], v[n:moved] = x, u
        if self._c_library.linearized_step(_address(_memory(v)), dt, self.max_step, self._c_p):
            return super().linearized_step(x, u, dt)  # which finds out what is wrong
        return LinearizedStep(v[moved:F], v[F:Q].reshape(n, n), v[Q:].reshape(n, n).T)


class NativeSensor(_Numbered, Sensor):
    """What a compiled sensor computes in C; all else is the sensor's."""

    _c_size: int

    def _c_called(self, function: Callable[..., Any], x: Array, size: int) -> Array | None:
        """Return ``size`` numbers for each of states (..., n); None if that is not their size."""
        if x.shape[-1] != self._c_size:
            return None
        last, count = x.size, x.size // self._c_size
        v = np.empty(last + count * size + 1)
        v[:last] = x.ravel()
        function(_address(_memory(v)), count, self._c_p, self._c_sets)
        return v[last:-1]

    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""
        k = self.output.size
        found = self._c_called(self._c_library.readings, x, k)
        if found is None or (x.ndim == 1 and not is_finite(found)):
            return super().measure(x)  # type: ignore[safe-super]
        return found.reshape(*x.shape[:-1], k)

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (..., k, n) at ``x`` (..., n)."""
        n, k = self._c_size, self.output.size
        found = self._c_called(self._c_library.slopes, x, n * k)
        if found is None:
            return super().jacobian(x)
        points = x.reshape(-1, n)
        H: Array = found.reshape(len(points), n, k).swapaxes(-1, -2)
        if not is_finite(found):
            for at, original in self._c_lost(H, NativeSensor):
                H[at] = original.jacobian(points[at])
        return H.reshape(*x.shape[:-1], k, n)


def _linearized(original: Any, x: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return F and Q of the original functions of a model; NaN where these fail, too."""
    try:
        with np.errstate(all='ignore'):
            _, F, Q = original.linearized_step(x, u, dt)
    except np.linalg.LinAlgError:
        F = Q = np.full((x.size, x.size), np.nan)
    return F, Q


def _lead(x: Array, u: Array) -> tuple[int, ...]:
    """Return the leading axes of vectors that broadcast."""
    if x.ndim == u.ndim == 1:
        return ()
    return np.broadcast_shapes(x.shape[:-1], u.shape[:-1])


class NativeSpace(Space):
    """A space with rotations whose differences are compiled, equal to the same one without."""

    _c_arrive: Callable[[int], None]
    _c_subtract: Callable[[int], None]

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
        self._c_arrive(_address(_memory(v)))
        return v[mean:end], v[end:].reshape(n, n)

    def subtract(self, a: Array, b: Array) -> Array:
        """Return the shortest difference ``a - b`` (..., n); of rotations, Log(Exp(a) Exp(-b))."""
        n = self.size
        if not (n,) == a.shape == b.shape:
            return super().subtract(a, b)
        v = np.empty(3 * n)
        v[:n], v[n : 2 * n] = a, b
        self._c_subtract(_address(_memory(v)))
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
    parameters, text = freed(model, _model_source)
    library = load(text, wait=wait)
    library.linearized_step.argtypes = [_POINTER, _NUMBER, _NUMBER, _POINTER]
    library.linearized_step.restype = ctypes.c_int
    _declare(library.rates)
    _declare(library.steps, _NUMBER, _NUMBER)
    _declare(library.noisy_steps, _NUMBER, _NUMBER)
    library.factors.argtypes, library.factors.restype = [_POINTER, ctypes.c_long], None
    _declare(library.noises, _NUMBER)
    _declare(library.linearized_steps, _NUMBER, _NUMBER)
    _declare(library.predictions, _NUMBER, _NUMBER, ctypes.c_long)
    library.corrections.argtypes = [_POINTER, ctypes.c_long, ctypes.c_long]
    library.corrections.restype = None
    declare(library)
    found: Model = derive(
        NativeModel,
        model,
        native_model,
        state=native_space(model.state, wait=wait),
        _c_library=library,
        _c_shapes=((model.state.size,), (model.input.size,)),
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
    parameters, text = freed(sensor, lambda given: _sensor_source(given, state))
    library = load(text, wait=wait)
    _declare(library.readings)
    _declare(library.slopes)
    found: Sensor = derive(
        NativeSensor,
        sensor,
        native_sensor,
        state,
        output=native_space(sensor.output, wait=wait),
        _c_library=library,
        _c_size=state.size,
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
        NativeSpace, space, native_space, _c_arrive=library.arrive, _c_subtract=library.subtract
    )
    return found


def _declare(function: Any, *arguments: Any) -> None:
    """Declare a function of an array, a number of members, arguments, numbers and their sets."""
    function.argtypes = [_POINTER, ctypes.c_long, *arguments, _POINTER, ctypes.c_long]
    function.restype = None


@lru_cache(maxsize=32)
def _model_source(parameters: Parameters) -> str:
    model: Any = parameters.original
    formulas = of_model(model, parameters)
    constants = {
        'N': model.state.size,
        'ORDER': model.state.size,
        'M': model.input.size,
        'COUNT': len(parameters.values),
        'MOST_SUBSTEPS': formulas.most,
        'MOST_READ': MOST_READ,
    }
    sparse = {'A': formulas.jacobian, 'W': formulas.density}
    if formulas.slope is not None:
        constants['SLOPE'], sparse['F'] = 1, formulas.slope
    return source(_STEPS, constants, formulas.traces, sparse)


@lru_cache(maxsize=64)
def _sensor_source(parameters: Parameters, state: Space) -> str:
    sensor: Any = parameters.original
    formulas = of_sensor(sensor, state, parameters)
    sizes = {'N': state.size, 'K': sensor.output.size, 'COUNT': len(parameters.values)}
    return source(['sensor.c'], sizes, formulas._asdict(), {'H': formulas.jacobian})


@lru_cache(maxsize=32)
def _space_source(space: Space) -> str:
    return source(['space.c'], {'N': space.size}, of_space(space)._asdict(), {})


def forget_formulas() -> None:
    """Trace again what looks like something known."""
    _model_source.cache_clear()
    _sensor_source.cache_clear()


def _pointed(numbers: Array) -> dict[str, Any]:
    """Return numbers, kept in memory, and their address."""
    kept = np.append(numbers, 0.0)  # none have no address
    return {'_c_numbers': kept, '_c_p': _address(_memory(kept))}
