# SPDX-License-Identifier: Apache-2.0
"""Models whose functions are compiled C."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import (
    Array,
    DiscreteModel,
    Dynamics,
    Gaussian,
    LinearizedStep,
    Model,
    is_finite,
    unchecked,
)
from kalman_ros.core.discrete_model import MOST_PERIODS, TOLERANCE
from kalman_ros.core.model import like

from .derived import derive
from .formulas import of_discrete_model, of_model
from .free_parameters import Parameters, freed
from .library import load
from .native_recursion import MOST_READ, NativeRecursion, declare_recursion
from .native_sensor import sensor_source
from .native_space import native_space
from .numbered import (
    COUNT,
    NUMBER,
    POINTER,
    Numbered,
    address,
    declare,
    function_address,
    hold,
    memory,
    pointed,
)
from .source import source

#: C of the matrices of a step in continuous time.
FLOW = 'series.c', 'matrices.c', 'flow.c'
_CONTINUOUS = (
    *FLOW, 'step.c', 'lanes.c', 'series.c', 'flows.c', 'beliefs.c', 'members.c', 'rates.c',
    'pass.c'
)  # fmt: skip
_DISCRETE = 'matrices.c', 'sampled.c', 'lanes.c', 'beliefs.c', 'members.c', 'pass.c'


class NativeDynamics(Numbered, NativeRecursion):
    """A model whose steps and linearisations are computed in C."""

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
            x, u = (np.broadcast_to(array, (*_lead(x, u), array.shape[-1])) for array in (x, u))
        first, count = x.size, x.size // x.shape[-1]
        middle = first + u.size
        last = middle + (0 if behind is None else behind.size)
        v = np.empty(last + count * size + 1)
        v[:first], v[first:middle] = x.ravel(), u.ravel()
        if behind is not None:
            v[middle:last] = behind.ravel()
        function(address(memory(v)), count, *arguments, self._c_p, self._c_sets)
        return v[last:-1]

    def _c_predicted(self, x: Array, P: Array, u: Array, dt: float, number: int) -> Gaussian:
        """Return the `predicted_moments` of many beliefs."""
        if x.ndim == 1 or number < 1:
            return super()._c_predicted(x, P, u, dt, number)
        n, u = x.shape[-1], like(u, x)
        covariances = np.broadcast_to(P, (*x.shape, n))
        step, lengths = self._c_library.predictions, (dt, self.max_step, number)
        moments = self._c_called(step, x, u, n + n * n, *lengths, behind=covariances)
        if moments is None:
            raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
        mean, covariance = moments[: x.size], moments[x.size :].reshape(-1, n, n)
        if not is_finite(moments):
            points, before = x.reshape(-1, n), covariances.reshape(-1, n, n)
            for k, original in self._c_lost(covariance, NativeDynamics):
                at, C, input = points[k], before[k], u.reshape(len(points), -1)[k]
                for _ in range(number):
                    F, Q = _linearized(original, at, input, dt)
                    at, C = original.step(at, input, dt), F @ C @ F.T + Q
                covariance[k] = C
        return unchecked((mean.reshape(x.shape), covariance.reshape(covariances.shape)))

    def corrected_moments(
        self, x: Array, P: Array, H: Array, R: Array, innovation: Array
    ) -> tuple[Array, Array, Array, Array, Any]:
        """Return means and covariances after readings, with K, S and NIS, of many at once."""
        n, lead, k = x.shape[-1], innovation.shape[:-1], innovation.shape[-1]
        if innovation.ndim == 1 or k > MOST_READ or (n,) != self._c_shapes[0]:
            return super().corrected_moments(x, P, H, R, innovation)
        given = (x, (n,)), (P, (n, n)), (H, (k, n)), (R, (k, k)), (innovation, (k,))
        count, at = math.prod(lead), 0
        v = np.empty(count * (2 * (n + n * n + n * k + k * k) + k + 1))
        for value, shape in given:
            end = at + count * math.prod(shape)
            v[at:end].reshape(*lead, *shape)[...] = value
            at = end
        self._c_library.corrections(address(memory(v)), count, k)
        results = []
        for size, shape_of_one in ((n, (n,)), (n * n, (n, n)), (n * k, (n, k)), (k * k, (k, k))):
            end = at + count * size
            results.append(v[at:end].reshape(*lead, *shape_of_one))
            at = end
        mean, covariance, K, S = results
        return mean, covariance, K, S, v[at:].reshape(lead)

    def noisy_step(self, x: Array, u: Array, dt: float, normal: Array) -> Array:
        """Return the states (..., n) after a step with the noise of standard normal numbers."""
        states, u = None, like(u, x)
        alike = x.shape == normal.shape and x.shape[:-1] == u.shape[:-1]
        if x.ndim > 1 and alike and not self.state.rotations:
            step, n = self._c_library.noisy_steps, x.shape[-1]
            states = self._c_called(step, x, u, n, dt, self.max_step, behind=normal)
        if states is None or not is_finite(states):
            return super().noisy_step(x, u, dt, normal)
        return states.reshape(x.shape)

    def covariance_factor(self, P: Array) -> Array:
        """Return L with L L' = P (..., n, n), NaN where P is not positive definite."""
        (n,) = self._c_shapes[0]
        if P.ndim == 2 or P.shape[-1] != n:
            return super().covariance_factor(P)
        v = np.empty(2 * P.size + 1)
        v[: P.size] = P.ravel()
        self._c_library.factors(address(memory(v)), P.size // (n * n))
        return v[P.size : -1].reshape(P.shape)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise."""
        u, n = like(u, x), x.shape[-1]
        states = self._c_called(self._c_library.steps, x, u, n, dt, self.max_step)
        if states is None:
            return super().step(x, u, dt)  # type: ignore[safe-super]  # which says what is wrong
        return states.reshape(*_lead(x, u), n)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q (..., n, n), what the noise adds in a step of length ``dt`` from x (..., n)."""
        return self.step_noise(x, u, dt)

    def step_noise(self, x: Array, u: Array, dt: float) -> Array:
        """Return the Q (..., n, n) of `linearized_step`."""
        if x.ndim == 1:
            return self.linearized_step(x, u, dt).Q
        n, u = x.shape[-1], like(u, x)
        covariances = self._c_called(self._c_library.noises, x, u, n * n, dt)
        if covariances is None:
            raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
        Q = covariances.reshape(-1, n, n)
        if not is_finite(covariances):
            for k, original in self._c_lost(Q, NativeDynamics):
                Q[k] = _linearized(original, x.reshape(-1, n)[k], u.reshape(len(Q), -1)[k], dt)[1]
        return Q.reshape(*x.shape, n)

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state (..., n) after a step with u (..., m), with the step's F and Q."""
        n = x.shape[-1]
        if x.ndim > 1:
            u = like(u, x)
            step = self._c_library.linearized_steps
            numbers = self._c_called(step, x, u, n + 2 * n * n, dt, self.max_step)
            if numbers is None:
                raise ValueError(f'x, u: expected (..., n) and (..., m), got {x.shape}, {u.shape}')
            count, shape = x.size // n, (*x.shape, n)
            both = numbers[count * n :].reshape(2, count, n, n)
            if not is_finite(numbers):
                for k, original in self._c_lost(both.swapaxes(0, 1), NativeDynamics):
                    at = x.reshape(count, n)[k], u.reshape(count, -1)[k]
                    both[:, k] = _linearized(original, *at, dt)
            F, Q = both.reshape(2, *shape)
            return LinearizedStep(numbers[: count * n].reshape(x.shape), F, Q)
        if (x.shape, u.shape) != self._c_shapes:
            return super().linearized_step(x, u, dt)
        moved = n + u.size
        F, Q = moved + n, moved + n + n * n
        v = np.empty(Q + n * n)
        v[:n], v[n:moved] = x, u
        if self._c_library.linearized_step(address(memory(v)), dt, self.max_step, self._c_p):
            return super().linearized_step(x, u, dt)  # which finds out what is wrong
        return LinearizedStep(v[moved:F], v[F:Q].reshape(n, n), v[Q:].reshape(n, n).T)


class NativeModel(NativeDynamics, Model):
    """A model in continuous time, whose rates are computed in C, too."""

    def derivative(self, x: Array, u: Array) -> Array:
        """Return dx/dt (..., n)."""
        rates = self._c_called(self._c_library.rates, x, u, x.shape[-1])
        if rates is None:
            return super().derivative(x, u)  # type: ignore[safe-super]
        return rates.reshape(*_lead(x, u), x.shape[-1])


class NativeDiscreteModel(NativeDynamics, DiscreteModel):
    """A model in discrete time, whose steps are computed in C."""

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds, a whole number of periods."""
        self.periods(dt)
        return super().step(x, u, dt)


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


def native_model(model: Dynamics, *, wait: bool = True) -> Any:
    """Return a model whose steps are compiled.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    CompilerError
        If it cannot be compiled, or without ``wait`` is not yet.
    """
    parameters, text = freed(model, _discrete_source if model.is_discrete else _model_source)
    library = load(text, wait=wait)
    _declare(library)
    space = native_space(model.state, wait=wait)
    return derive(
        NativeDiscreteModel if model.is_discrete else NativeModel,
        model,
        native_model,
        state=space,
        _c_library=library,
        _c_arrived=function_address(getattr(space, '_c_arrive', None)),
        _c_shapes=((model.state.size,), (model.input.size,)),
        **pointed(parameters.values),
    )


def _declare(library: Any) -> None:
    """Declare the functions of the library of a model."""
    hold(library, 'linearized_step', ctypes.c_int, POINTER, NUMBER, NUMBER, POINTER)
    if hasattr(library, 'rates'):
        declare(library, 'rates')
    declare(library, 'steps', NUMBER, NUMBER)
    declare(library, 'noisy_steps', NUMBER, NUMBER)
    hold(library, 'factors', None, POINTER, COUNT)
    declare(library, 'noises', NUMBER)
    declare(library, 'linearized_steps', NUMBER, NUMBER)
    hold(library, 'corrections', None, POINTER, COUNT, COUNT)
    declare_recursion(library)


def _constants(model: Dynamics, parameters: Parameters) -> dict[str, float]:
    return {
        'N': model.state.size,
        'ORDER': model.state.size,
        'M': model.input.size,
        'COUNT': len(parameters.values),
        'MOST_READ': MOST_READ,
    }


@lru_cache(maxsize=32)
def _model_source(parameters: Parameters) -> str:
    model: Any = parameters.original
    formulas = of_model(model, parameters)
    constants = {**_constants(model, parameters), 'MOST_SUBSTEPS': formulas.most}
    sparse = {'A': formulas.jacobian, 'W': formulas.density}
    if formulas.slope is not None:
        constants['SLOPE'], sparse['F'] = 1, formulas.slope
    return source(_CONTINUOUS, constants, formulas.traces, sparse)


@lru_cache(maxsize=32)
def _discrete_source(parameters: Parameters) -> str:
    model: Any = parameters.original
    formulas = of_discrete_model(model, parameters)
    constants = {
        **_constants(model, parameters),
        'MOST_PERIODS': MOST_PERIODS,
        'TOLERANCE': TOLERANCE,
    }
    sparse = {'F': formulas.slope, 'W': formulas.density}
    return source(_DISCRETE, constants, formulas._asdict(), sparse)


def forget_formulas() -> None:
    """Trace again what looks like something known."""
    for function in (_model_source, _discrete_source, sensor_source):
        function.cache_clear()
