# SPDX-License-Identifier: Apache-2.0
"""Whether a model or a sensor, maybe a user's own, returns what it should: asked at the start."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kalman_ros.core import Array, Model, Sensor

#: The commonest mistake in a model or a sensor of one's own.
_AT_ONCE = 'of two states at once (x[..., 0], not x[0])'


def _check(what: str, call: Callable[[], Any], shape: tuple[int, ...]) -> None:
    """Raise ValueError if a method of a user's own fails, or returns another shape."""
    try:
        found = np.shape(call())
    except Exception as error:
        kind = type(error).__name__
        raise ValueError(f'{what} fails: {kind}: {error}') from error
    if found != shape:
        raise ValueError(f'{what}: expected the shape {shape}, got {found}')


def check_model(model: Model, x: Array) -> None:
    """Raise ValueError if what a model returns about a state (n,) has not the right shape."""
    n, u = x.size, model.equilibrium.input
    two, both = np.stack((x, x)), np.stack((u, u))
    _check('model: its derivative', lambda: model.derivative(x, u), (n,))
    _check(f'model: its derivative {_AT_ONCE}', lambda: model.derivative(two, both), (2, n))
    _check('model: its noise_density', lambda: model.noise_density(x), (n, n))
    _check('model: its state_jacobian', lambda: model.state_jacobian(x, u), (n, n))


def check_sensor(name: str, sensor: Sensor, x: Array) -> None:
    """Raise ValueError if what a sensor returns for a state (n,) has not the right shape."""
    k, n = sensor.output.size, x.size
    two = np.stack((x, x))
    _check(f'{name}.kind: its covariance', lambda: sensor.covariance, (k, k))
    _check(f'{name}.kind: its measure', lambda: sensor.measure(x), (k,))
    _check(f'{name}.kind: its measure {_AT_ONCE}', lambda: sensor.measure(two), (2, k))
    _check(f'{name}.kind: its jacobian', lambda: sensor.jacobian(x), (k, n))
