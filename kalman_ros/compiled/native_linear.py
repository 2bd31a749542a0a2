# SPDX-License-Identifier: Apache-2.0
"""Linear systems with steps, predictions and corrections in C, and sensors linear in the state.

The C depends on the numbers of states and inputs alone, so that it is compiled once for all
systems of a size, and needs no formulas.
"""

from __future__ import annotations

from ctypes import c_int
from functools import lru_cache
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, LinearSystem, Sensor, Space
from kalman_ros.core.dynamics import Transition
from kalman_ros.linear.discretize import TERMS

from .derived import derive
from .library import HEAD, load
from .native_pass import matrix_numbers
from .native_recursion import MOST_READ, NativeRecursion, declare_recursion
from .numbered import NUMBER, POINTER, address, hold, memory, pointed, reads
from .source import text

#: Most states of a system in C: for more the products of BLAS are as fast.
MOST_STATES = 16
#: Fewest states for which wider registers save more time than the compiler takes for them.
_WIDE = 8
#: What a class of a user may compute otherwise.
_STEPS = 'sampled', 'step', 'transition', 'linearized_step', 'predicted_moments'
_FILES = 'matrices.c', 'linear.c', 'lanes.c', 'beliefs.c', 'pass.c'
_WRAP = """
static void wrap(const real *x, real *wrapped)
{
    static const int angles[] = ANGLES;
    memcpy(wrapped, x, N * sizeof *x);
    for (int i = 0; i < ANGLE_COUNT; i++) {
        const real turn = 2 * acos(-1.0), left = fmod(x[angles[i]] + turn / 2, turn);
        wrapped[angles[i]] = (left < 0 ? left + turn : left) - turn / 2;
    }
}
"""


class NativeLinearSystem(NativeRecursion, LinearSystem):
    """A linear system whose steps are C, and the predictions and corrections of one belief."""

    arithmetic = 'C'
    _c_arrived = 0

    def sampled(self, dt: float) -> Transition:
        """Return the exact step of length ``dt``."""
        (n,), (m,) = self._c_shapes
        at_G = n * n
        at_Q = at_G + n * m
        v = np.empty(at_Q + n * n)
        if self._c_library.sampled(address(memory(v)), dt, self._c_p):
            return super().sampled(dt)
        return Transition(
            v[:at_G].reshape(n, n), v[at_G:at_Q].reshape(n, m), v[at_Q:].reshape(n, n)
        )


class NumberedSensor(Sensor):
    """A linear sensor whose numbers C reads, y = H x + c; its functions are those of numpy."""

    arithmetic = 'numpy'
    _c_sets = 1
    _c_p: int
    _c_turns: Array
    _c_shapes: tuple[tuple[int], tuple[int]]
    _c_reads: tuple[int, int, int, int]


def is_small(system: Dynamics) -> bool:
    """Return whether a linear system has steps of its matrices alone, and not too many states."""
    kind: Any = type(system)
    exact = all(getattr(kind, name, None) is getattr(LinearSystem, name) for name in _STEPS)
    return exact and system.state.size <= MOST_STATES


def native_linear_system(system: LinearSystem, *, wait: bool = True) -> Any:
    """Return a linear system of which beliefs are predicted and corrected in C.

    Raises
    ------
    CompilerError
        If it cannot be compiled, or without ``wait`` is not yet.
    """
    shapes = (system.state.size,), (system.input.size,)
    library = load(_source(*shapes[0], *shapes[1], _angles(system.state)), wait=wait)
    declare_recursion(library)
    hold(library, 'sampled', c_int, POINTER, NUMBER, POINTER)
    norm, terms = system.series
    return derive(
        NativeLinearSystem,
        system,
        native_linear_system,
        _c_library=library,
        _c_shapes=shapes,
        **pointed(np.append(norm, terms)),
    )


def numbered_sensor(sensor: Sensor, state: Space) -> Any:
    """Return a linear sensor without rotations with the numbers that C reads.

    Raises
    ------
    ValueError
        If its matrices do not have the sizes of its spaces.
    """
    n, k = state.size, sensor.output.size
    matrix = matrix_numbers(sensor, n)
    if matrix.shape != (k * n + k,) or sensor.covariance.shape != (k, k):
        raise ValueError(f'{sensor!r}: expected H ({k}, {n}), R ({k}, {k}) and a reading ({k},)')
    numbers = pointed(matrix)
    return derive(
        NumberedSensor,
        sensor,
        numbered_sensor,
        state,
        _c_shapes=((n,), (k,)),
        **reads(0, numbers['_c_p'], sensor.output),  # a matrix needs no function
        **numbers,
    )


def _angles(state: Space) -> tuple[int, ...]:
    return tuple(index for index, name in enumerate(state.names) if name in state.angles)


@lru_cache(maxsize=64)
def _source(n: int, m: int, angles: tuple[int, ...]) -> str:
    constants = {'N': n, 'ORDER': n, 'M': m, 'TERMS': TERMS, 'MOST_READ': MOST_READ, 'COUNT': 0}
    constants['ANGLE_COUNT'] = len(angles)
    listed = f'#define ANGLES {{{", ".join(map(str, angles)) or 0}}}\n'
    head = HEAD if n >= _WIDE else f'{HEAD}#undef FAST\n#define FAST\n'
    return text(_FILES, constants, head, listed, _WRAP)
