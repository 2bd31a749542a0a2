# SPDX-License-Identifier: Apache-2.0
"""Start-up checks that a model or sensor, perhaps a user's own, returns valid values."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from numbers import Real
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, OperatingPoint, Sensor, Space, semidefinite
from kalman_ros.models import check_spaces

#: The most common mistake in a user's model or sensor.
_AT_ONCE = 'of several states at once (x[..., 0], not x[0])'


def _check(what: str, call: Callable[[], Any], shape: tuple[int, ...]) -> None:
    """Raise ValueError if a user's method fails, or does not return finite numbers of a shape."""
    try:
        with np.errstate(all='ignore'):
            output = np.asarray(call())
            values = output.real.astype(float)
    except Exception as error:
        kind = type(error).__name__
        reason = str(error).partition('\n')[0]
        raise ValueError(f'{what} fails: {kind}: {reason}') from error
    if values.shape != shape:
        raise ValueError(f'{what}: expected the shape {shape}, got {values.shape}')
    if np.iscomplexobj(output):
        raise ValueError(f'{what}: expected real numbers at initial_estimate, got complex ones')
    if not np.isfinite(values).all():
        shown = np.array2string(values, threshold=6, separator=', ').replace('\n', '')
        raise ValueError(f'{what}: expected finite numbers at initial_estimate, got {shown}')


def check_equilibrium(model: Dynamics) -> None:
    """Raise ValueError if a model lacks a space, or its equilibrium or longest step is wrong."""
    check_spaces(model)
    try:
        point = model.equilibrium
    except Exception as error:
        kind = type(error).__name__
        raise ValueError(f'model: its equilibrium fails: {kind}: {error}') from error
    if not isinstance(point, OperatingPoint):
        expected = 'expected OperatingPoint(state, input), of kalman_ros.core'
        raise ValueError(f'model: its equilibrium: {expected}, got {point!r}')
    for name, value, space in zip(('state', 'input'), point, (model.state, model.input)):
        if not isinstance(value, np.ndarray):
            raise ValueError(f"model: its equilibrium's {name}: expected an array, got {value!r}")
        _check(f"model: its equilibrium's {name}", partial(np.copy, value), (space.size,))
    longest = model.max_step
    if not isinstance(longest, Real) or not longest > 0.0:
        raise ValueError(f'model: its max_step: expected a number of seconds, got {longest!r}')


def _several(v: Array, count: int) -> Array:
    """Return the same vector several times, (count, n), read-only."""
    return np.broadcast_to(v, (count, v.size))


def check_model(model: Dynamics, x: Array) -> None:
    """Raise ValueError if a model returns a wrong shape for a state (n,), or changes it."""
    n, u = x.size, model.equilibrium.input
    # as many states as coordinates would fit along the wrong axis, too
    count = 1 + max(n, u.size)
    xs, us = _several(x, count), _several(u, count)
    of: Any = model
    moves, noise = ('next', 'noise') if model.is_discrete else ('derivative', 'noise_density')
    move = getattr(of, moves)
    _check(f'model: its {moves}', lambda: move(xs[0], us[0]), (n,))
    _check(f'model: its {moves} {_AT_ONCE}', lambda: move(xs, us), (count, n))
    _check(f'model: its {noise}', lambda: getattr(of, noise)(x), (n, n))
    semidefinite(f'model: its {noise}', getattr(of, noise)(x), n)
    if model.is_discrete:
        _check('model: its next_jacobian', lambda: of.next_jacobian(x, u)[0], (n, n))
    else:
        _check('model: its state_jacobian', lambda: of.state_jacobian(x, u), (n, n))


def check_attributes(sensor: Sensor) -> None:
    """Raise ValueError if a sensor lacks an attribute that its constructor must set."""
    for attribute, kind in (('output', Space), ('covariance', np.ndarray)):
        value = getattr(sensor, attribute, None)
        if not isinstance(value, kind):
            expected = f'expected {kind.__name__}, which its __init__ sets'
            raise ValueError(f'kind: its {attribute}: {expected}, got {value!r}')


def check_sensor(name: str, sensor: Sensor, x: Array) -> None:
    """Raise ValueError if a sensor returns a wrong shape for a state (n,)."""
    k, n = sensor.output.size, x.size
    count = 1 + max(k, n)
    xs = _several(x, count)
    _check(f'{name}.kind: its covariance', lambda: sensor.covariance, (k, k))
    _check(f'{name}.kind: its measure', lambda: sensor.measure(xs[0]), (k,))
    _check(f'{name}.kind: its measure {_AT_ONCE}', lambda: sensor.measure(xs), (count, k))
    _check(f'{name}.kind: its jacobian', lambda: sensor.jacobian(x), (k, n))
    if sensor.linear and not sensor.output.turns:  # a rotation is linear in its errors alone
        # of the size of the state, so that neither rounding nor a small curvature matters
        away = np.linspace(0.3, 0.5, n) * np.maximum(1.0, np.abs(x))
        change = sensor.output.subtract(sensor.measure(x + away), sensor.measure(x))
        if not np.allclose(change, sensor.jacobian(x) @ away, rtol=1e-3, atol=1e-9):
            raise ValueError(
                f'{name}.kind: its readings do not change as its Jacobian says, so it cannot have '
                'linear = True'
            )
