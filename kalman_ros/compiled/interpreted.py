# SPDX-License-Identifier: Apache-2.0
"""Models and sensors whose formulas CasADi evaluates: for machines without a C compiler."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from threading import Lock
from typing import Any

import numpy as np

from kalman_ros.core import Array, LinearizedStep, Model, Sensor, Space, is_finite
from kalman_ros.linear.discretize import flow, noise_integral

from .derived import derive
from .formulas import of_model, of_sensor
from .free_parameters import freed
from .tracing import Trace

_memory: Callable[[Any], Any] = memoryview


class Evaluation:
    """A traced function of vectors, with its arguments and result in private memory."""

    def __init__(self, trace: Trace) -> None:
        function = trace.function('f')
        self._buffer, self._run = function.buffer()
        self._arguments = [np.zeros(variable.numel()) for variable in trace.variables]
        for index, argument in enumerate(self._arguments):
            self._buffer.set_arg(index, _memory(argument))
        rows, columns = trace.result.sparsity().get_triplet()
        self._shape, self._places = trace.result.shape, (rows, columns)
        self._numbers = np.zeros(len(rows))
        self._buffer.set_res(0, _memory(self._numbers))
        self._lock = Lock()

    def __call__(self, *vectors: Array | float) -> Array:
        """Return the result as a matrix (n, m)."""
        result = np.zeros(self._shape)
        with self._lock:
            for argument, vector in zip(self._arguments, vectors):
                argument[:] = vector
            self._run()
            result[self._places] = self._numbers
        return result


class InterpretedModel(Model):
    """What CasADi computes of a model, for one state; all else is the model's."""

    arithmetic = 'CasADi'
    _c_substep: Evaluation
    _c_wrap: Evaluation
    _c_jacobian: Evaluation
    _c_density: Evaluation
    _c_slope: Evaluation | None = None
    _c_most: int
    _c_shapes: tuple[tuple[int], tuple[int]]
    _c_numbers: Array

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """Return the state (..., n) after ``dt`` seconds with ``u`` held, without noise."""
        if (x.shape, u.shape) != self._c_shapes:
            return super().step(x, u, dt)
        return self._c_moved(x, u, dt)[0]

    def linearized_step(self, x: Array, u: Array, dt: float) -> LinearizedStep:
        """Return the state after a step from x (n,) with u (m,), with the step's F and Q."""
        if (x.shape, u.shape) != self._c_shapes:
            return super().linearized_step(x, u, dt)
        A, W = self._c_jacobian(x, u, self._c_numbers), self._c_density(x, self._c_numbers)
        if not (is_finite(A) and is_finite(W)):  # there is no exact derivative
            return super().linearized_step(x, u, dt)
        F, Q = flow(A, W, dt)
        moved, of_step = self._c_moved(x, u, dt, self._c_slope)
        return LinearizedStep(moved, F if of_step is None else of_step, Q)

    def noise_covariance(self, x: Array, u: Array, dt: float) -> Array:
        """Return Q (n, n), what the noise adds in a step of length ``dt`` from x (n,)."""
        if (x.shape, u.shape) != self._c_shapes:
            return super().noise_covariance(x, u, dt)
        A, W = self._c_jacobian(x, u, self._c_numbers), self._c_density(x, self._c_numbers)
        if not (is_finite(A) and is_finite(W)):
            return super().noise_covariance(x, u, dt)
        return noise_integral(A, W, dt)

    def _c_moved(
        self, x: Array, u: Array, dt: float, slope: Evaluation | None = None
    ) -> tuple[Array, Array | None]:
        """Return the state after a step, and the product of the slopes of its substeps."""
        count = min(self.substeps(dt), self._c_most)
        h, F = dt / count, None
        for _ in range(count):
            if slope is not None:
                F_1 = slope(x, u, h, self._c_numbers)
                F = F_1 if F is None else F_1 @ F
            x = self._c_substep(x, u, h, self._c_numbers)[:, 0]
        return self._c_wrap(x)[:, 0], F


class InterpretedSensor(Sensor):
    """What CasADi computes of a sensor, for one state; all else is the sensor's."""

    arithmetic = 'CasADi'
    _c_measure: Evaluation
    _c_jacobian: Evaluation
    _c_shape: tuple[int]
    _c_numbers: Array

    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""
        if x.shape != self._c_shape:
            return super().measure(x)  # type: ignore[safe-super]
        return self._c_measure(x, self._c_numbers)[:, 0]

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (k, n) at ``x`` (n,)."""
        if x.shape != self._c_shape:
            return super().jacobian(x)
        H = self._c_jacobian(x, self._c_numbers)
        return H if is_finite(H) else super().jacobian(x)


def interpreted_model(model: Model) -> Model:
    """Return a model in continuous time whose steps are evaluated as formulas.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    """
    parameters, formulas = freed(model, lambda given: of_model(model, given))
    derived: Model = derive(
        InterpretedModel,
        model,
        interpreted_model,
        _c_numbers=parameters.values,
        _c_most=formulas.most,
        _c_shapes=((model.state.size,), (model.input.size,)),
        **_evaluations(formulas.traces),
    )
    return derived


def interpreted_sensor(sensor: Sensor, state: Space) -> Sensor:
    """Return a sensor of states in a space whose reading and Jacobian are evaluated as formulas.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    """
    parameters, formulas = freed(sensor, lambda given: of_sensor(sensor, state, given))
    derived: Sensor = derive(
        InterpretedSensor,
        sensor,
        interpreted_sensor,
        state,
        _c_shape=(state.size,),
        _c_numbers=parameters.values,
        **_evaluations(formulas._asdict()),
    )
    return derived


def _evaluations(traces: Mapping[str, Trace]) -> dict[str, Evaluation]:
    return {f'_c_{name}': Evaluation(formula) for name, formula in traces.items()}
