# SPDX-License-Identifier: Apache-2.0
"""Where a model rests: a state and an input that do not change it."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Dynamics, OperatingPoint

#: The largest change at rest, relative to what the state and the input make of it, or absolutely,
#: and Newton's steps and halvings.
STILL, _TINY, _STEPS, _HALVINGS = 1e-6, 1e-9, 60, 20
#: How far nearby is, relative to 1 and the coordinate.
_AWAY = 0.05
#: Steps go on until a change is this small.
_EXACT = 1e-12


def change(model: Dynamics, x: Array, u: Array) -> Array:
    """Return by how much a model changes, in a second or in a period (n,)."""
    if model.is_discrete:
        return model.state.subtract(model.step(x, u, model.period), x)
    rate: Array = model.derivative(x, u)  # type: ignore[attr-defined]
    return rate


def is_still(model: Dynamics, point: OperatingPoint) -> bool:
    """Return whether a model rests at a point.

    A coordinate may change if nothing depends on it and no input acts on it directly, as the
    position of a car at a speed: not only here, where a derivative may vanish, but nearby, too.
    """
    A, B = _jacobians(model, point)
    size = np.maximum(np.abs(A) @ np.abs(point.state), np.abs(B) @ np.abs(point.input))
    still: Array = np.abs(change(model, *point)) <= STILL * size + _TINY
    if still.all():
        return True
    counts = np.any(A != 0.0, axis=0) | np.any(B != 0.0, axis=1)
    with np.errstate(all='ignore'):  # nearby there may be nothing
        for sign in (1.0, -1.0):
            A, B = _jacobians(model, _beside(model, point, sign))
            counts |= np.any(A != 0.0, axis=0) | np.any(B != 0.0, axis=1)
    return bool(np.all(still[counts]))


def _beside(model: Dynamics, point: OperatingPoint, sign: float = 1.0) -> OperatingPoint:
    """Return a point at some distance, different in each coordinate."""
    x, u = (
        sign * _AWAY * (1.0 + np.abs(part)) * (1.0 + 0.1 * np.arange(len(part))) for part in point
    )
    return OperatingPoint(model.state.add(point.state, x), point.input + u)


def unrest(model: Dynamics, point: OperatingPoint) -> str:
    """Return what changes most at a point, and by how much."""
    moved = change(model, *point)
    most = int(np.argmax(np.abs(np.nan_to_num(moved, nan=np.inf))))
    return f'{model.state.names[most]} changes by {moved[most]:.4g} in a ' + (
        'period' if model.is_discrete else 'second'
    )


def find_rest(
    model: Dynamics, start: OperatingPoint, free_state: Array, free_input: Array
) -> OperatingPoint:
    """Return where a model rests near a start, by Newton's method with the shortest steps.

    Parameters
    ----------
    model
        The model.
    start
        State (n,) and input (m,) at which the search begins.
    free_state, free_input
        Which coordinates (n,) and (m,) may change.

    Raises
    ------
    ValueError
        If it finds none; the message names what still changes.
    """
    space, point = model.state, start
    free = np.concatenate((free_state, free_input))
    with np.errstate(all='ignore'):  # a step may be far too long
        moved = change(model, *point)
        for _ in range(_STEPS):
            if not np.isfinite(moved).all() or np.abs(moved).max(initial=0.0) < _EXACT:
                break
            jacobian = np.hstack(_jacobians(model, point))[:, free]
            if not np.isfinite(jacobian).all():
                break
            if not jacobian.any():  # as in the middle of a parabola
                beside = np.concatenate(_beside(model, point))
                both = np.where(free, beside, np.concatenate(point))
                point = OperatingPoint(*np.split(both, [space.size]))
                moved = change(model, *point)
                continue
            step = np.zeros(len(free))
            step[free] = -np.linalg.lstsq(jacobian, moved, rcond=None)[0]
            dx, du = np.split(step, [space.size])
            for halving in range(_HALVINGS):
                share = 0.5**halving
                tried = OperatingPoint(
                    space.add(point.state, share * dx), point.input + share * du
                )
                after = change(model, *tried)
                if np.linalg.norm(after) < np.linalg.norm(moved):
                    point, moved = tried, after
                    break
            else:
                break
    if not is_still(model, point):
        raise ValueError(f'it finds no rest: {unrest(model, point)} at the nearest point')
    return point


def _jacobians(model: Dynamics, point: OperatingPoint) -> tuple[Array, Array]:
    """Return the derivatives of `change` by the state (n, n) and the input (n, m)."""
    if model.is_discrete:
        F, G = model.next_jacobian(*point)  # type: ignore[attr-defined]
        return F - np.eye(len(F)), G
    return (
        model.state_jacobian(*point),  # type: ignore[attr-defined]
        model.input_jacobian(*point),  # type: ignore[attr-defined]
    )
