# SPDX-License-Identifier: Apache-2.0
"""The modes of a system: which decay, stay or grow, and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import Literal

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.structure import ComplexArray, continuous_poles, eigenvalues

#: Matrices that differ by this, relative to their norm, are equal up to rounding.
_ROUNDING = 1e-13
#: Left and right null vectors closer than this to a right angle belong to a Jordan block. Two
#: eigenvalues that rounding cannot tell apart, d from each other, have d^2 / 4 = _ROUNDING.
_DEFECTIVE = 2.0 * _ROUNDING**0.5

Fate = Literal['decays', 'stays', 'grows']


@dataclass(frozen=True)
class Mode:
    """One eigenvalue, or one complex pair, of dx/dt = A x or of x' = F x.

    Parameters
    ----------
    pole
        s in 1/s, with Im s >= 0; of a sampled mode z it is log(z) / dt.
    fate
        ``'decays'``, ``'stays'`` (bounded for ever) or ``'grows'``, even if only linearly in
        time, as the position of a free body does.
    """

    pole: complex
    fate: Fate

    @property
    def time_constant(self) -> float:
        """Seconds in which it falls to, or grows from, 1/e: 1 / |Re s|; inf on the boundary."""
        return 1.0 / abs(self.pole.real) if self.pole.real else inf

    @property
    def natural_frequency(self) -> float:
        """|s| in rad/s."""
        return abs(self.pole)

    @property
    def damping_ratio(self) -> float:
        """-Re s / |s|: 1 without oscillation, 0 without damping, NaN at s = 0."""
        if np.isinf(self.pole.real):
            return 1.0
        return -self.pole.real / abs(self.pole) if self.pole else nan

    def __str__(self) -> str:
        s = self.pole
        text = f'{s.real:.3g} ± {s.imag:.3g}j' if s.imag else f'{s.real:.3g}'
        parts = [f'{text} 1/s {self.fate}']
        if self.pole.real:
            parts.append(f'time constant {self.time_constant:.3g} s')
        if s.imag:
            parts.append(
                f'natural frequency {self.natural_frequency:.3g} rad/s, '
                f'damping ratio {self.damping_ratio:.3g}'
            )
        return ', '.join(parts)


def modes(A: Array, dt: float | None = None) -> tuple[Mode, ...]:
    """Return the modes of dx/dt = A x, or of x' = A x with samples of ``dt``.

    The first is the one that grows most, the last decays fastest; a complex pair is one mode.

    An eigenvalue is on the stability boundary if a change of A within rounding puts it there
    (Trefethen and Embree, Spectra and Pseudospectra, 2005). There a mode stays only if it is
    semisimple, which is to say has as many eigenvectors as its multiplicity; with a Jordan
    block, as of the double integrator, it grows (Rugh, Linear System Theory, 1996, chapter 6).

    Parameters
    ----------
    A
        A square matrix (n, n).
    dt
        Seconds a sample; None in continuous time.
    """
    A = np.asarray(A, dtype=float)
    upper_modes = []
    for eigenvalue in eigenvalues(A):
        edge = _boundary_point(A, complex(eigenvalue), sampled=dt is not None)
        point = complex(eigenvalue) if edge is None else edge
        s = point if dt is None else complex(continuous_poles(np.array([point]), dt)[0])
        if edge is not None:
            s = complex(0.0, s.imag)
            fate: Fate = 'stays' if _is_semisimple(A, edge) else 'grows'
        else:
            fate = 'decays' if s.real < 0.0 else 'grows'
        if s.imag >= 0.0:
            upper_modes.append(Mode(s, fate))
    return tuple(sorted(upper_modes, key=lambda mode: (-mode.pole.real, mode.pole.imag)))


def _boundary_point(A: Array, eigenvalue: complex, *, sampled: bool) -> complex | None:
    """Return the point of the stability boundary that equals ``eigenvalue`` up to rounding.

    That is so if a change of A within rounding has an eigenvalue there and on the way there;
    otherwise the point belongs to another eigenvalue.
    """
    if sampled:
        nearest = eigenvalue / abs(eigenvalue) if eigenvalue else 1.0
        candidates = [1.0, -1.0, nearest]
    else:
        candidates = [0.0, 1j * eigenvalue.imag]
    for point in map(complex, candidates):
        if all(_is_eigenvalue(A, s) for s in (point, 0.5 * (point + eigenvalue))):
            return point
    return None


def _is_eigenvalue(A: Array, s: complex) -> bool:
    return bool(_shifted(A, s)[1][-1] <= _ROUNDING * np.linalg.norm(A, 2))


def _shifted(A: Array, s: complex) -> tuple[ComplexArray, Array, ComplexArray]:
    """Return the singular value decomposition of A - s I."""
    U, sizes, Vh = np.linalg.svd(A - s * np.eye(len(A)))
    return U, sizes, Vh


def _is_semisimple(A: Array, s: complex) -> bool:
    """Return whether eigenvalue s has no Jordan block: its left and right null spaces pair up."""
    U, sizes, Vh = _shifted(A, s)
    size = int(np.sum(sizes <= _ROUNDING * np.linalg.norm(A, 2)))
    pairing = Vh[-size:] @ U[:, -size:]
    return bool(np.linalg.svd(pairing, compute_uv=False)[-1] > _DEFECTIVE)
