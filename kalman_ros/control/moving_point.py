# SPDX-License-Identifier: Apache-2.0
"""A moving set point: the input that a state needs to move as it does, without an error.

Coordinates that the input does not act on directly, such as a position, follow from the others.
The input keeps the others, such as a velocity, at their rates: at rest where none is given. A
speed that it does not act on directly, behind the lag of an actuator, may not change either.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, Model

#: An element of B this small, relative to the largest, is zero.
_NO_EFFECT = 1e-9
#: The input may act nonlinearly: Newton's steps.
_STEPS = 3


class SteadyInput(NamedTuple):
    """An input (m,), and by how much the rates (n,) miss those that are wanted."""

    input: Array
    missed: Array


def driven(model: Model, x: Array, u: Array) -> Array:
    """Return which coordinates (n,) the input acts on directly, as booleans."""
    size = np.abs(model.input_jacobian(x, u)).max(axis=1, initial=0.0)
    mask: Array = size > _NO_EFFECT * size.max(initial=0.0)
    return mask


def steady_input(model: Model, x: Array, rate: Array) -> SteadyInput:
    """Return the input with which the driven coordinates of x (n,) change at a ``rate`` (n,).

    Where no input does that, the sum of squared differences is the least.
    """
    u = model.equilibrium.input
    for _ in range(_STEPS):
        B = model.input_jacobian(x, u)
        rows = driven(model, x, u)
        missed = np.where(rows, rate - model.derivative(x, u), 0.0)
        u = u + np.linalg.lstsq(B[rows], missed[rows], rcond=None)[0]
    kept = np.logical_or(driven(model, x, u), _speeds(model))
    return SteadyInput(u, np.where(kept, rate - model.derivative(x, u), 0.0))


def _speeds(model: Model) -> Array:
    """Return which coordinates (n,) are in the unit of another one by s, as booleans."""
    units = model.state.units
    return np.array([unit.endswith('/s') and unit[:-2] in units for unit in units])
