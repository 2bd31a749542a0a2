# SPDX-License-Identifier: Apache-2.0
"""Linear systems of the studies, as parameters of the model ``linear``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kalman_ros.core import ArrayLike, LinearSystem, linearize
from kalman_ros.scenario import build

CART_STATES = {'x': 'm', 'v': 'm/s'}
CART_READING = np.array([[1.0, 0.0]])


def linear(
    states: Mapping[str, str],
    A: ArrayLike,
    B: ArrayLike,
    W: ArrayLike,
    C: ArrayLike,
    noise: Sequence[float],
    **others: Any,
) -> dict[str, Any]:
    """Return the parameters of dx/dt = A x + B u + w with one sensor y = C x + v, ``reading``.

    Parameters
    ----------
    states
        Names of the states, with their units.
    A, B, C
        Matrices (n, n), (n, m) and (k, n).
    W
        Spectral density of w: a diagonal (n,) or a matrix.
    noise
        Standard deviations of v (k,).
    others
        Further parameters; a double underscore stands for a dot.
    """
    names, (n, m), k = list(states), np.shape(B), len(noise)
    inputs = [f'u{index}' for index in range(m)]
    parameters = {
        'states': names,
        'state_units': list(states.values()),
        'inputs': inputs,
        'input_units': [''] * m,
        'A': _flat(A),
        'B': _flat(B),
        'noise_density': _flat(W),
    }
    return {
        'model': 'linear',
        **{f'model_parameters.{key}': value for key, value in parameters.items()},
        'sensors': ['reading'],
        'reading.kind': 'linear',
        'reading.C': _flat(C),
        'reading.noise': [float(sigma) for sigma in noise],
        'reading.rate': 100.0,
        'reading.topic': 'reading',
        'reading.type': 'sensor_msgs/JointState',
        'reading.fields': [f'position[y{index}]' for index in range(k)],
        'state.topic': 'estimate',
        'state.type': 'sensor_msgs/JointState',
        'state.fields': [f'position[{name}]' for name in names],
        'input.topic': 'command',
        # with a stamp, so that repeated answers can be recognised
        'input.type': 'sensor_msgs/JointState',
        'input.fields': [f'effort[{name}]' for name in inputs],
        'state_cost': [1.0] * n,
        'input_cost': [1.0] * m,
        'initial_state': [0.0] * n,
        'initial_estimate': [0.0] * n,
        'initial_std': [1.0] * n,
        **{key.replace('__', '.'): value for key, value in others.items()},
    }


def cart(density: Sequence[float], noise: float, rate: float, **others: Any) -> dict[str, Any]:
    """Return a cart on a rail with the acceleration u as its input; its position is measured.

    Parameters
    ----------
    density
        Diagonal of the spectral density of the process noise (2,).
    noise
        Standard deviation of the reading, in metres.
    rate
        Rate of the loop and of the readings, in Hz.
    others
        Further parameters, as for `linear`.
    """
    return carts(1, density, noise, rate, **others)


def carts(
    count: int, density: Sequence[float], noise: float, rate: float, **others: Any
) -> dict[str, Any]:
    """Return several independent carts; see `cart`."""
    identity = np.eye(count)
    states = {
        f'{name}{index}': unit for index in range(count) for name, unit in CART_STATES.items()
    }
    return linear(
        states,
        np.kron(identity, [[0.0, 1.0], [0.0, 0.0]]),
        np.kron(identity, [[0.0], [1.0]]),
        [*density] * count,
        np.kron(identity, CART_READING),
        [noise] * count,
        rate=rate,
        reading__rate=rate,
        **others,
    )


def plant(parameters: Mapping[str, Any]) -> LinearSystem:
    """Return the linear system of parameters, for its theory."""
    model = build(parameters).model
    return linearize(model, *model.equilibrium)


def _flat(matrix: ArrayLike) -> list[float]:
    return [float(number) for number in np.ravel(np.asarray(matrix, dtype=float))]
