# SPDX-License-Identifier: Apache-2.0
"""Any linear system, given as numbers: A, B and the noise, in a parameter file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, LinearSystem, Space, matrix, semidefinite

#: Units of the double integrator.
_UNITS = ('m', 'm/s')


def linear(
    states: Annotated[Sequence[str], About('names of the states')] = ('x', 'v'),
    state_units: Annotated[Sequence[str], About('their units, one each; else none')] = _UNITS,
    angles: Annotated[Sequence[str], About("states that wrap at +-pi, or ''")] = ('',),
    inputs: Annotated[Sequence[str], About('names of the inputs')] = ('u',),
    input_units: Annotated[Sequence[str], About('their units, one each; else none')] = ('',),
    A: Annotated[Sequence[float], About('state matrix, row by row')] = (0.0, 1.0, 0.0, 0.0),
    B: Annotated[Sequence[float], About('input matrix, row by row')] = (0.0, 1.0),
    noise_density: Annotated[
        Sequence[float],
        About('spectral density of the process noise: the diagonal, or row by row'),
    ] = (0.0, 0.1),
) -> LinearSystem:
    """Return dx/dt = A x + B u + w; a double integrator by default."""
    units = _units('state_units', state_units, _UNITS, len(states))
    state = Space(tuple(states), units, tuple(a for a in angles if a))
    input = Space(tuple(inputs), _units('input_units', input_units, ('',), len(inputs)))
    n, m = state.size, input.size
    W = semidefinite('noise_density', np.array(noise_density), n)
    return LinearSystem(matrix('A', A, (n, n)), matrix('B', B, (n, m)), W, state, input)


def _units(
    name: str, listed: Sequence[str], default: tuple[str, ...], size: int
) -> tuple[str, ...]:
    """Return one unit each: the ``listed`` ones, or none where only the default is listed."""
    units = tuple(listed)
    if units == default and len(units) != size:
        return ('',) * size
    if len(units) != size:
        raise ValueError(f'{name}: expected {size} units, got {len(units)}')
    return units


MODEL = linear
