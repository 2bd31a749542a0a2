# SPDX-License-Identifier: Apache-2.0
"""The frequencies at which a scalar loop crosses the real axis, or a circle about the origin.

No grid is searched, so none is missed: with L~(s) = L(-s), which on the imaginary axis is the
conjugate of L, they are the zeros of L - L~, or of r^2 - L~ L, that lie on that axis, and zeros
are generalised eigenvalues (Bruinsma and Steinbuch, Systems and Control Letters 14, 1990, for
the second; Emami-Naeini and Van Dooren, Automatica 18(4), 1982). Newton's method then takes
them to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np
from scipy.linalg import eig, matrix_balance

from kalman_ros.core import Array

from .state_space import StateSpace

#: A zero this close to the imaginary axis, relative to its size, may be on it.
_NEAR = 1e-3
#: Newton's steps; it doubles digits, but two crossings close together slow it down.
_STEPS = 30
#: The residual of the equation at a crossing, relative to its terms.
_EXACT = 1e-9
#: The distance of poles from z = -1, as of a state that changes its sign at each sample.
_ALTERNATING = 1e-6
#: Crossings closer to each other than this, relative to their size, are one.
_SAME = 1e-9

#: An equation's value at w, its slope, and the size of its terms.
Residual = Callable[[float], tuple[float, float, float]]


def continuous(loop: StateSpace) -> StateSpace:
    """Return a loop with s in place of z: s = (2/dt)(z - 1)/(z + 1) maps the circle to the axis.

    Stability, and every value along the axis, are unchanged; only frequencies are warped: see
    `frequency`. A pole at z = -1, which would be at infinity, is moved by 1e-6. A loop in
    continuous time is returned balanced, with entries of one size.
    """
    A, B, C, D = loop.A, loop.B, loop.C, loop.D
    if loop.dt is not None:
        eye = np.eye(len(A))
        if np.any(np.abs(loop.poles + 1.0) < _ALTERNATING):
            A = (1.0 - _ALTERNATING) * A
        M = np.linalg.inv(eye + A)
        scale = 2.0 / np.sqrt(loop.dt)
        A, B, C, D = (2.0 / loop.dt) * M @ (A - eye), scale * M @ B, scale * C @ M, D - C @ M @ B
    return balanced(StateSpace(A, B, C, D))


def balanced(system: StateSpace) -> StateSpace:
    """Return the same continuous system (m, m) with states scaled so that entries have one size.

    All inputs and outputs share one unit, so no value changes.
    """
    A, B, C, D = system.A, system.B, system.C, system.D
    # together with B and C, since an integrator alone has no scale
    whole = np.block([[A, B], [C, np.zeros_like(D)]])
    matrix, (scale, _) = matrix_balance(whole, permute=False, separate=True)
    n = len(A)
    state_scale = scale[n:] / np.exp(np.mean(np.log(scale[n:])))
    return StateSpace(
        matrix[:n, :n],
        matrix[:n, n:] / state_scale,
        matrix[n:, :n] * state_scale[:, np.newaxis],
        D,
    )


def frequency(bent: float, dt: float | None) -> float:
    """Return the frequency in rad/s for one along the axis of `continuous`."""
    return bent if dt is None else 2.0 / dt * float(np.arctan(0.5 * bent * dt))


def real_crossings(loop: StateSpace) -> Array:
    """Return the w > 0 (k,), ascending, at which L(jw) of a continuous scalar loop is real."""
    A, B, C = loop.A, loop.B, loop.C
    n = len(A)
    # s x = A x + B u, s p = -A'p - C'u, 0 = C x - B'p
    pencil = np.block([
        [A, np.zeros((n, n)), B],
        [np.zeros((n, n)), -A.T, -C.T],
        [C, -B.T, np.zeros((1, 1))],
    ])  # fmt: skip

    def residual(w: float) -> tuple[float, float, float]:
        L, slope = _value(loop, w)
        return L.imag, slope.imag, abs(L)

    return _polished(pencil, residual)


def level_crossings(loop: StateSpace, level: float = 1.0) -> Array:
    """Return the w > 0 (k,), ascending, at which a continuous scalar |L(jw)| is ``level``."""

    def residual(w: float) -> tuple[float, float, float]:
        L, slope = _value(loop, w)
        return abs(L) ** 2 - level**2, 2.0 * (L.conjugate() * slope).real, level**2

    return _polished(_level_pencil(loop, level), residual)


def singular_crossings(system: StateSpace, level: float) -> Array:
    """Return the w > 0 (k,), ascending, where a singular value of M(jw) (p, m) is ``level``.

    The system is continuous. Values are not refined, and may include frequencies where a singular
    value only comes close.
    """
    return _near_axis(_level_pencil(system, level), system.B.shape[1])


def level_candidates(system: StateSpace, level: float) -> Array:
    """Return all w > 0 (k,), ascending, that may be where a singular value of M(jw) is ``level``.

    They include those of zeros that rounding may have moved from the imaginary axis, however far.
    """
    return _near_axis(_level_pencil(system, level), system.B.shape[1], inf)


def _level_pencil(system: StateSpace, level: float) -> Array:
    A, B, C, D = system.A, system.B, system.C, system.D
    n, m = B.shape
    # s x = A x + B u, s p = -A'p - C'y, 0 = level^2 u - B'p - D'y, y = C x + D u
    return np.block([
        [A, np.zeros((n, n)), B],
        [-C.T @ C, -A.T, -C.T @ D],
        [-D.T @ C, -B.T, level**2 * np.eye(m) - D.T @ D],
    ])  # fmt: skip


def _value(loop: StateSpace, w: float) -> tuple[complex, complex]:
    """Return L(jw) and dL/dw."""
    M = 1j * w * np.eye(len(loop.A)) - loop.A
    X = np.linalg.solve(M, loop.B.astype(complex))
    L = loop.C @ X + loop.D
    slope = -1j * loop.C @ np.linalg.solve(M, X)
    return complex(L[0, 0]), complex(slope[0, 0])


def _polished(pencil: Array, residual: Residual) -> Array:
    """Return the zeros of a scalar loop's pencil on the imaginary axis, above the origin."""
    frequencies: list[float] = []
    for start in _near_axis(pencil, 1).tolist():
        w = _newton(residual, start)
        if w is not None and not any(abs(w - other) <= _SAME * w for other in frequencies):
            frequencies.append(w)
    return np.sort(np.array(frequencies))


def _near_axis(pencil: Array, inputs: int, near: float = _NEAR) -> Array:
    """Return the heights (k,) of the zeros near the imaginary axis, above 0, ascending."""
    E = np.eye(len(pencil))
    E[-inputs:, -inputs:] = 0.0
    alpha, beta = eig(pencil, E, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > np.finfo(float).eps * np.abs(alpha)
    s = alpha[finite] / beta[finite]
    close = s[(s.imag > 0.0) & (np.abs(s.real) <= near * np.abs(s))]
    return np.sort(close.imag)


def _newton(residual: Residual, w: float) -> float | None:
    """Return the root nearest to ``w``, or None if there is none, as where L has a pole."""
    try:
        for _ in range(_STEPS):
            value, slope, _ = residual(w)
            step = value / slope if slope else 0.0
            w = min(max(w - step, 0.5 * w), 2.0 * w)
            if abs(step) <= 1e-15 * w:
                break
        value, _, terms = residual(w)
    except np.linalg.LinAlgError:
        return None
    return w if abs(value) <= _EXACT * terms else None
