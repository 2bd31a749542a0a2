# SPDX-License-Identifier: Apache-2.0
"""Sensors whose functions are compiled C."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, Sensor, Space, is_finite

from .derived import derive
from .formulas import of_sensor
from .free_parameters import Parameters, freed
from .library import load
from .native_space import native_space
from .numbered import Numbered, address, declare, function_address, memory, pointed, reads
from .source import source


class NativeSensor(Numbered, Sensor):
    """A sensor whose reading and Jacobian are computed in C."""

    _c_size: int
    _c_shapes: tuple[tuple[int], tuple[int]]
    #: A whole turn of each angle.
    _c_turns: Array
    #: Addresses of the function that reads, its numbers, the difference, and the turns.
    _c_reads: tuple[int, int, int, int]

    def _c_called(self, function: Callable[..., Any], x: Array, size: int) -> Array | None:
        """Return ``size`` numbers for each of states (..., n); None if that is not their size."""
        if x.shape[-1] != self._c_size:
            return None
        last, count = x.size, x.size // self._c_size
        v = np.empty(last + count * size + 1)
        v[:last] = x.ravel()
        function(address(memory(v)), count, self._c_p, self._c_sets)
        return v[last:-1]

    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""
        k = self.output.size
        readings = self._c_called(self._c_library.readings, x, k)
        if readings is None or (x.ndim == 1 and not is_finite(readings)):
            return super().measure(x)  # type: ignore[safe-super]
        return readings.reshape(*x.shape[:-1], k)

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (..., k, n) at ``x`` (..., n)."""
        n, k = self._c_size, self.output.size
        slopes = self._c_called(self._c_library.slopes, x, n * k)
        if slopes is None:
            return super().jacobian(x)
        points = x.reshape(-1, n)
        H: Array = slopes.reshape(len(points), n, k).swapaxes(-1, -2)
        if not is_finite(slopes):
            for at, original in self._c_lost(H, NativeSensor):
                H[at] = original.jacobian(points[at])
        return H.reshape(*x.shape[:-1], k, n)


def native_sensor(sensor: Sensor, state: Space, *, wait: bool = True) -> Sensor:
    """Return a sensor of states in a space whose reading and Jacobian are compiled.

    Raises
    ------
    UntraceableError
        If a function cannot be traced.
    CompilerError
        If it cannot be compiled, or without ``wait`` is not yet.
    """
    parameters, text = freed(sensor, lambda given: sensor_source(given, state))
    library = load(text, wait=wait)
    declare(library, 'readings')
    declare(library, 'slopes')
    output = native_space(sensor.output, wait=wait)
    numbers = pointed(parameters.values)
    derived: Sensor = derive(
        NativeSensor,
        sensor,
        native_sensor,
        state,
        output=output,
        _c_library=library,
        _c_size=state.size,
        _c_shapes=((state.size,), (output.size,)),
        **reads(function_address(library.sensed), numbers['_c_p'], output),
        **numbers,
    )
    return derived


@lru_cache(maxsize=64)
def sensor_source(parameters: Parameters, state: Space) -> str:
    """Return the formulas of a sensor as C; what has the same attributes has the same ones."""
    sensor: Any = parameters.original
    formulas = of_sensor(sensor, state, parameters)
    sizes = {'N': state.size, 'K': sensor.output.size, 'COUNT': len(parameters.values)}
    return source(['sensor.c'], sizes, formulas._asdict(), {'H': formulas.jacobian})
