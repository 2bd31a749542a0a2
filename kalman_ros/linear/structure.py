# SPDX-License-Identifier: Apache-2.0
"""Which modes of a system the input can move and the readings can see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .matrices import Array

#: Below this, relative to the norm of the matrices, a singular value counts as zero.
_RANK_TOLERANCE = 1e-9

#: A share this small of a unit vector is rounding.
_NO_SHARE = 1e-6

#: Balancing ends after N sweeps; it takes a few.
_SWEEPS = 30

ComplexArray = npt.NDArray[np.complex128]


def eigenvalues(A: Array) -> ComplexArray:
    """Return the eigenvalues of ``A`` (n, n), complex also where they are all real."""
    return np.asarray(np.linalg.eigvals(A), dtype=np.complex128)


def is_stable(A: Array | ComplexArray, *, sampled: bool) -> bool:
    """Return whether all eigenvalues of ``A`` (n, n) decay: |z| < 1 sampled, else Re s < 0."""
    poles = np.linalg.eigvals(A)
    return bool(np.all(np.abs(poles) < 1.0) if sampled else np.all(poles.real < 0.0))


def continuous_poles(poles: ComplexArray, dt: float) -> ComplexArray:
    """Return s = log(z) / dt of sampled poles z; a pole at zero becomes minus infinity."""
    with np.errstate(divide='ignore'):
        growth = np.log(np.abs(poles))  # apart from the angle, since complex -inf / dt has a NaN
    return np.asarray(growth / dt + 1j * (np.angle(poles) / dt), dtype=np.complex128)


def uncontrollable_modes(A: Array, B: Array) -> ComplexArray:
    """Return the eigenvalues of ``A`` (n, n) that the input through ``B`` (n, m) cannot move.

    By the test of Popov, Belevitch and Hautus: s is uncontrollable where [A - s I, B] loses
    rank, with A balanced, and A and B each relative to its size: neither the unit of time nor
    that of the inputs matters. For the modes that readings C cannot see, call with A^T and C^T.
    """
    return np.array([s for s, _ in _uncontrollable(A, B)], dtype=complex)


def _uncontrollable(A: Array, B: Array) -> list[tuple[complex, ComplexArray]]:
    """Return each uncontrollable eigenvalue with a w (n,) of w'[A - s I, B] = 0."""
    units = balancing(A)
    rate = float(np.linalg.norm(A * units / units[:, np.newaxis])) or 1.0
    A = A * units / units[:, np.newaxis] / rate
    B = B / units[:, np.newaxis]
    B = B / (float(np.linalg.norm(B)) or 1.0)
    missed = []
    for s in eigenvalues(A):
        left, sizes, _ = np.linalg.svd(np.hstack((A - s * np.eye(len(A)), B)))
        if sizes[-1] < _RANK_TOLERANCE:
            missed.append((rate * complex(s), left[:, -1]))
    return missed


def balancing(A: Array) -> Array:
    """Return powers of two (n,), units of the states in which rows and columns are of one size.

    B. Parlett and C. Reinsch, Balancing a Matrix for Calculation of Eigenvalues and Eigenvectors,
    Numerische Mathematik 13, 1969. scipy has it, in a package that takes a third of a second to
    import.
    """
    units, off = np.ones(len(A)), np.abs(A)
    np.fill_diagonal(off, 0.0)
    for _ in range(_SWEEPS):
        before = units.copy()
        for i in range(len(A)):
            row, column = np.linalg.norm(off[i]), np.linalg.norm(off[:, i])
            if row > 0.0 and column > 0.0 and np.isfinite(row * column):
                factor = 2.0 ** round(0.5 * np.log2(row / column))
                units[i] *= factor
                off[i] /= factor
                off[:, i] *= factor
        if np.array_equal(units, before):
            break
    return units


def observed(A: Array, C: Array) -> npt.NDArray[np.bool_]:
    """Return for each state (n,) whether readings C (k, n) of dx/dt = A x determine it.

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
    return np.asarray(np.abs(kernel).max(axis=0, initial=0.0) < _NO_SHARE)


def unstable(modes: ComplexArray, *, sampled: bool) -> ComplexArray:
    """Return those of ``modes`` that do not decay: |z| >= 1 when sampled, else Re s >= 0."""
    margin = np.abs(modes) - 1.0 if sampled else modes.real
    return modes[margin >= -1e-12]


def describe(modes: ComplexArray) -> str:
    """Return eigenvalues as text, ``-1.00+2.00j, 0.50``."""
    return ', '.join(map(_text, modes))


def describe_distinct(modes: ComplexArray) -> str:
    """Return eigenvalues as text, each once, however many modes it has."""
    return ', '.join(dict.fromkeys(map(_text, modes)))


def _text(s: complex) -> str:
    return f'{s.real:.3g}' if abs(s.imag) < 1e-12 else f'{s:.3g}'


def _parted(some: tuple[str, ...], others: tuple[str, ...]) -> str:
    """Return the two groups of states as text."""
    if not some:
        return f'none of {", ".join(others)}'
    return f'{", ".join(some)}; not {", ".join(others)}' if others else ', '.join(some)


@dataclass(frozen=True)
class HiddenMode:
    """A mode that the input cannot move, or the readings cannot see.

    Parameters
    ----------
    pole
        Its eigenvalue; of a complex pair the one above the real axis.
    states
        The states that take part in the hidden mode.
    """

    pole: complex
    states: tuple[str, ...]

    def __str__(self) -> str:
        return f'{describe(np.array([self.pole]))} ({", ".join(self.states)})'


@dataclass(frozen=True)
class Controllability:
    """What an input can control.

    Parameters
    ----------
    reached, unreached
        The states that the input can, and cannot, drive to any value.
    hidden
        The modes that the input does not move.
    stabilizable
        Whether all of those decay.
    """

    reached: tuple[str, ...]
    unreached: tuple[str, ...]
    hidden: tuple[HiddenMode, ...]
    stabilizable: bool

    def __str__(self) -> str:
        return f'the input controls {_parted(self.reached, self.unreached)}'


@dataclass(frozen=True)
class Observability:
    """What readings determine.

    Parameters
    ----------
    seen, unseen
        The states that the readings determine, and those that they do not.
    hidden
        The modes that the readings do not show.
    detectable
        Whether all of those decay.
    """

    seen: tuple[str, ...]
    unseen: tuple[str, ...]
    hidden: tuple[HiddenMode, ...]
    detectable: bool

    def __str__(self) -> str:
        return f'the sensors observe {_parted(self.seen, self.unseen)}'


def observability(
    A: Array, C: Array, names: Sequence[str], *, sampled: bool = False
) -> Observability:
    """Return which named states the readings C (k, n) of dx/dt = A x, or x' = A x, determine."""
    mask = observed(A, C)
    hidden = tuple(
        HiddenMode(s, tuple(np.array(names)[np.abs(w) > _NO_SHARE].tolist()))
        for s, w in _uncontrollable(A.T, C.T)
        if s.imag >= 0.0
    )
    poles = np.array([mode.pole for mode in hidden], dtype=complex)
    return Observability(
        tuple(name for name, there in zip(names, mask) if there),
        tuple(name for name, there in zip(names, mask) if not there),
        hidden,
        not unstable(poles, sampled=sampled).size,
    )


def controllability(
    A: Array, B: Array, names: Sequence[str], *, sampled: bool = False
) -> Controllability:
    """Return which named states the input through B (n, m) controls; dual of observability."""
    dual = observability(A.T, B.T, names, sampled=sampled)
    return Controllability(dual.seen, dual.unseen, dual.hidden, dual.detectable)
