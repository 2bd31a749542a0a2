# SPDX-License-Identifier: Apache-2.0
"""Which modes of a system the input can move and the readings can see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array

#: Below this, relative to the norm of the matrices, a singular value counts as zero.
_RANK_TOLERANCE = 1e-9


ComplexArray = npt.NDArray[np.complex128]


def eigenvalues(A: Array) -> ComplexArray:
    """Return the eigenvalues of ``A`` (n, n), complex also where they are all real."""
    return np.asarray(np.linalg.eigvals(A), dtype=np.complex128)


def uncontrollable_modes(A: Array, B: Array) -> ComplexArray:
    """Return the eigenvalues of ``A`` (n, n) that the input through ``B`` (n, m) cannot move.

    By the test of Popov, Belevitch and Hautus: s is uncontrollable where [A - s I, B] loses
    rank. For the modes that readings C cannot see, call with A^T and C^T.
    """
    scale = max(1.0, float(np.linalg.norm(A)), float(np.linalg.norm(B)))
    missed = [
        s
        for s in eigenvalues(A)
        if np.linalg.svd(np.hstack((A - s * np.eye(len(A)), B)), compute_uv=False)[-1]
        < _RANK_TOLERANCE * scale
    ]
    return np.array(missed, dtype=complex)


def observed(A: Array, C: Array) -> npt.NDArray[np.bool_]:
    """Tell of each state (n,) whether readings C (k, n) of dx/dt = A x determine it.

    A state is determined if no vector in the kernel of the observability matrix
    [C; C A; ...; C A^(n-1)] moves it (Kalman, 1960).
    """
    n = len(A)
    A = A / max(1.0, float(np.linalg.norm(A, 2)))
    rows = [C]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    _, sizes, directions = np.linalg.svd(np.vstack([*rows, np.zeros((n, n))]))
    kernel = directions[sizes[:n] <= _RANK_TOLERANCE * max(1.0, float(sizes[0]))]
    return np.asarray(np.abs(kernel).max(axis=0, initial=0.0) < 1e-6)


def unstable(modes: ComplexArray, *, sampled: bool) -> ComplexArray:
    """Return those of ``modes`` that do not decay: |z| >= 1 when sampled, else Re s >= 0."""
    margin = np.abs(modes) - 1.0 if sampled else modes.real
    return modes[margin >= -1e-12]


def describe(modes: ComplexArray) -> str:
    """Return eigenvalues as text, ``-1.00+2.00j, 0.50``."""
    return ', '.join(f'{s.real:.3g}' if abs(s.imag) < 1e-12 else f'{s:.3g}' for s in modes)
