# SPDX-License-Identifier: Apache-2.0
"""Pole placement for state feedback and observers.

With several inputs the method is that of Tits and Yang (IEEE Trans. Automatic Control 41(10),
1996), whose poles are least sensitive to model errors; with one input the gain is unique. A pole
that is repeated more often than there are inputs has chains of eigenvectors.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .discretize import zero_order_hold
from .errors import DesignError
from .matrices import Array
from .structure import (
    ComplexArray,
    balancing,
    describe,
    describe_distinct,
    eigenvalues,
    uncontrollable_modes,
)

#: Placed poles further from the requested ones than this, relative to the largest, are an error.
_ACCURACY = 1e-4

#: Coefficients of the polynomial of repeated poles may be off by this much, relative to the
#: largest, and those of one input by rounding; the number of gains that are tried for them.
_OFF, _EXACT, _TRIES = 1e-6, 1e-13, 12

#: Poles that differ by less, relative to the largest, are equal.
_SAME = 1e-7

#: Each added pole lies this much further left, relative to the fastest one given.
_SPREAD = 0.1


@dataclass(frozen=True)
class PlacementDesign:
    """A gain with the requested poles.

    Parameters
    ----------
    gain
        K (m, n) of a state feedback u = -K x, or L (n, k) of an observer.
    poles
        The eigenvalues (n,) of A - B K, or of A - L C; as asked for where they are repeated.
    """

    gain: Array
    poles: ComplexArray


def place(A: Array, B: Array, poles: Sequence[complex]) -> PlacementDesign:
    """Return the K (m, n) with the eigenvalues of A - B K at ``poles``.

    For x' = F x + G u give F, G and poles in the z plane, or see `sampled_place`.

    Parameters
    ----------
    A, B
        Matrices (n, n) and (n, m).
    poles
        n numbers; a complex one comes with its conjugate.

    Raises
    ------
    ValueError
        If the number of poles is wrong, or a conjugate is missing.
    DesignError
        If the input does not move every mode, or moves one too little.
    """
    wanted = _gathered(_checked(len(A), poles))
    _refuse_stuck(A, B)
    return _placed(A, B, wanted, lambda z: z)


def _refuse_stuck(A: Array, B: Array) -> None:
    stuck = uncontrollable_modes(A, B)
    if stuck.size:
        raise DesignError(f'poles: no input moves the modes at {describe_distinct(stuck)}')


def _placed(
    A: Array, B: Array, wanted: ComplexArray, shown: Callable[[ComplexArray], ComplexArray]
) -> PlacementDesign:
    """Return the gain of the method that is nearest; an error shows poles as ``shown``."""
    independent, repeated = _rank(B), _most_repeated(wanted)
    methods = [_chained_gain]
    if repeated <= independent:
        methods.insert(0, lambda A, B, poles: _robust_gain(A, B, poles, independent))
    enough = _OFF
    if B.shape[1] == 1:  # the gain is unique, and the most accurate one is taken
        methods.insert(0, _gain_of_one_input)
        enough = _EXACT
    best, off, achieved = None, np.inf, np.full(len(A), np.nan, dtype=complex)
    # as robust as can be in the units that are given, unless they are too different
    for method in methods:
        for units in (np.ones(len(A)), balancing(A)):
            scaled = A * units / units[:, np.newaxis], B / units[:, np.newaxis]
            try:
                K = method(*scaled, wanted)
            except (ValueError, np.linalg.LinAlgError):
                continue
            closed = scaled[0] - scaled[1] @ K
            wrong = _distance(closed, wanted)
            if wrong < off:
                best, off, achieved = K / units, wrong, eigenvalues(closed)
            if best is not None and off <= enough:
                # eigenvalues of a chain of k scatter by the k-th root of the rounding
                return PlacementDesign(best, achieved if repeated <= independent else wanted)
    near = _farthest(achieved, wanted) <= _ACCURACY * np.abs(wanted).max()
    if best is not None and (off <= _OFF or (repeated <= independent and near)):
        return PlacementDesign(best, achieved if repeated <= independent else wanted)
    raise DesignError(
        f'poles: some mode is moved too little to be placed: asked for '
        f'{describe(shown(wanted))}, the best gain gives {describe(shown(achieved))}'
    )


def _rank(B: Array) -> int:
    """Return the number of independent inputs."""
    sizes = np.linalg.svd(B, compute_uv=False)
    return int(np.sum(sizes > max(B.shape) * np.finfo(float).eps * sizes[0]))


def _robust_gain(A: Array, B: Array, poles: ComplexArray, rank: int) -> Array:
    """Return the K (m, n) of Tits and Yang, for inputs of which ``rank`` are independent."""
    from scipy.signal import place_poles  # slow to import, so only here

    # in a unit of time in which A and the poles are near one
    rate = max(float(np.abs(poles).max()), float(np.abs(eigenvalues(A)).max())) or 1.0
    U, sizes, Vh = np.linalg.svd(B / rate, full_matrices=False)
    # scipy rejects linearly dependent inputs; they share by least squares
    inputs = U[:, :rank] * (sizes[:rank] / sizes[0])
    with warnings.catch_warnings():
        # robustness that stops short of its optimum; the poles are checked by the caller
        warnings.simplefilter('ignore', UserWarning)
        gain = place_poles(A / rate, inputs, poles / rate).gain_matrix
    return np.asarray(Vh[:rank].T / sizes[0] @ gain, dtype=float)


def _gathered(poles: ComplexArray) -> ComplexArray:
    """Return poles of which those that differ by rounding are equal: 0.1 * 3 is 0.3."""
    gathered: ComplexArray = poles.copy()
    near = _SAME * (float(np.abs(poles).max()) or 1.0)
    for k, pole in enumerate(gathered):
        if abs(pole.imag) <= near:
            gathered[k] = pole.real
        for other in gathered[:k]:
            for same in (other, other.conjugate()):
                if abs(gathered[k] - same) <= near:
                    gathered[k] = same
    return gathered


def _most_repeated(poles: ComplexArray) -> int:
    """Return how often the most frequent of some poles is there."""
    return max(int(np.sum(poles == pole)) for pole in poles)


def _chained_gain(A: Array, B: Array, poles: ComplexArray) -> Array:
    """Return a K (m, n) for poles that are repeated, each of which has chains of eigenvectors.

    With J a real Jordan form of the poles and any G, A X - X J = B G and K = G X^-1 give
    (A - B K) X = X J (S. Bhattacharyya and E. de Souza, Pole assignment via Sylvester's equation,
    Systems and Control Letters 1(4), 1982). The best conditioned X of some G is taken.
    """
    from scipy.linalg import solve_sylvester

    n, m = B.shape
    random = np.random.default_rng(0)
    rate = max(float(np.abs(poles).max()), float(np.abs(eigenvalues(A)).max())) or 1.0
    size = float(np.linalg.norm(B, 2)) / rate
    J = _jordan(poles / rate)
    best, least = np.zeros((m, n)), np.inf
    for k in range(_TRIES):
        # X has no solution where A has one of the poles: it is moved first
        moved = np.zeros((m, n)) if k % 2 == 0 else 0.3 * random.standard_normal((m, n)) / size
        G = random.standard_normal((m, n))
        X = solve_sylvester(A / rate - B / rate @ moved, -J, B / rate / size @ G)
        condition = float(np.linalg.cond(X)) if np.isfinite(X).all() else np.inf
        if condition < least:
            best, least = moved + np.linalg.solve(X.T, G.T).T / size, condition
    return best


def _gain_of_one_input(A: Array, B: Array, poles: ComplexArray) -> Array:
    """Return the K (1, n) of one input, by its polynomial on the Hessenberg form.

    Where reflections have made A a Hessenberg matrix H and B a multiple b of the first axis, K is
    the last row of the product of all H - p, divided by b and by all numbers below the diagonal
    of H (B. N. Datta, An Algorithm to Assign Eigenvalues in a Hessenberg Matrix: Single Input
    Case, IEEE Trans. Automatic Control 32(5), 1987). Numbers are as long as the processor has.
    """
    n = len(A)
    rate = max(float(np.abs(poles).max()), float(np.abs(eigenvalues(A)).max())) or 1.0
    H = np.zeros((n + 1, n + 1), dtype=np.longdouble)
    H[1:, :1], H[1:, 1:] = B / rate, A / rate
    turn = np.eye(n + 1, dtype=np.longdouble)
    for k in range(n - 1):  # zeros below the first number under the diagonal (A. Householder)
        v = H[:, k].copy()
        v[: k + 1] = 0.0
        v[k + 1] += np.copysign(np.sqrt(v.dot(v)), v[k + 1])
        if size := v.dot(v):
            for M in (H, H.T, turn.T):
                M -= np.outer(v, 2.0 / size * v.dot(M))
    row = np.zeros(n, dtype=np.longdouble)
    row[-1] = 1.0
    below, H = H.diagonal(-1), H[1:, 1:]
    if not below.all():
        raise np.linalg.LinAlgError('a mode is out of reach')
    for pole in poles[poles.imag >= 0.0].astype(np.clongdouble) / rate:
        if pole.imag:
            row = (row @ H - 2.0 * pole.real * row) @ H + abs(pole) ** 2 * row
        else:
            row = row @ H - pole.real * row
    return np.asarray(row / np.prod(below) @ turn[1:, 1:].T, dtype=float)[np.newaxis]


def _farthest(achieved: ComplexArray, wanted: ComplexArray) -> float:
    """Return the largest distance of wanted poles from found ones, each of which counts once."""
    away = np.abs(achieved[:, np.newaxis] - wanted)
    farthest = 0.0
    for _ in wanted:
        i, k = np.unravel_index(np.argmin(away), away.shape)
        farthest = max(farthest, float(away[i, k]))
        away[i, :] = away[:, k] = np.inf
    return farthest


def _distance(closed: Array, poles: ComplexArray) -> float:
    """Return how far the characteristic polynomial of a matrix is from that of some poles.

    It is the largest difference of two coefficients, relative to the largest coefficient.
    """
    if not np.isfinite(closed).all():
        return np.inf
    rate = float(np.abs(poles).max()) or 1.0
    wanted, coefficients = np.poly(poles / rate), np.poly(closed / rate)
    return float(np.abs(coefficients - wanted).max() / np.abs(wanted).max())


def _jordan(poles: ComplexArray) -> Array:
    """Return a real matrix (n, n) with a chain of each pole as long as it is often."""
    J = np.zeros((len(poles), len(poles)))
    at = 0
    for pole in np.unique(poles[poles.imag >= 0.0]):
        count, width = int(np.sum(poles == pole)), 2 if pole.imag else 1
        block = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])[:width, :width]
        for k in range(count):
            J[at : at + width, at : at + width] = block
            if k + 1 < count:
                J[at : at + width, at + width : at + 2 * width] = np.eye(width)
            at += width
    return J


def sampled_place(A: Array, B: Array, poles: Sequence[complex], dt: float) -> PlacementDesign:
    """Return the gain for an input held over steps of ``dt``, with ``poles`` in 1/s.

    A pole s becomes z = exp(s dt), so that the samples follow a continuous loop with the poles
    s. The `PlacementDesign` has the z. The gain is that of differences, (F - 1) / dt and
    poles (z - 1) / dt, which stay what they are where steps are short (R. Middleton and
    G. Goodwin, Digital Control and Estimation: A Unified Approach, 1990).

    Raises
    ------
    ValueError, DesignError
        As `place`; DesignError if samples hide a mode that the input moves, as those of half a
        period do.
    """
    rates = _checked(len(A), poles)
    _refuse_stuck(A, B)
    _, held = zero_order_hold(A, np.eye(len(A)), dt)
    changes = A @ held / dt, held @ B / dt
    with np.errstate(over='ignore', invalid='ignore'):
        wanted = _gathered(np.asarray(np.expm1(rates * dt) / dt, dtype=complex))
    if not np.isfinite(wanted).all():
        raise DesignError(f'poles: samples of {dt:g} s have none at {describe(rates)}')

    def shown(delta: ComplexArray) -> ComplexArray:
        with np.errstate(divide='ignore'):
            return np.asarray(np.log1p(delta.astype(complex) * dt) / dt)

    lost = uncontrollable_modes(*changes)
    if lost.size:
        modes = describe_distinct(shown(lost))
        raise DesignError(f'poles: in samples of {dt:g} s no input moves the modes at {modes}')
    design = _placed(*changes, wanted, shown)
    return PlacementDesign(design.gain, 1.0 + dt * design.poles)


def spread_poles(name: str, poles: Sequence[float], count: int) -> list[float]:
    """Return ``count`` real parts in 1/s, the given ones first.

    The k-th added one is (1 + k / 10) times the fastest given one, so that no pole repeats: a
    repeated one is the most sensitive to errors of the model.

    Raises
    ------
    ValueError
        If there are none, or more than ``count``.
    """
    given = [float(pole) for pole in poles]
    if not 1 <= len(given) <= count:
        raise ValueError(f'{name}: expected 1 to {count} numbers, got {len(given)}')
    fastest = min(given)
    return given + [fastest * (1.0 + _SPREAD * k) for k in range(1, count - len(given) + 1)]


def pole_pairs(
    names: tuple[str, str], real: Sequence[float], imaginary: Sequence[float], count: int
) -> list[complex]:
    """Return ``count`` poles in 1/s from the values of two parameters.

    Parameters
    ----------
    names
        Of the parameters.
    real, imaginary
        Their values: real parts, completed by `spread_poles`, and imaginary parts, zero where
        not given.
    count
        The number of states.

    Raises
    ------
    ValueError
        If there are none, or more than ``count``.
    """
    parts = spread_poles(names[0], real, count)
    if len(imaginary) > count:
        raise ValueError(f'{names[1]}: expected at most {count} numbers, got {len(imaginary)}')
    return [complex(re, imaginary[k] if k < len(imaginary) else 0.0) for k, re in enumerate(parts)]


def place_observer(A: Array, C: Array, poles: Sequence[complex]) -> PlacementDesign:
    """Return Luenberger's L (n, k) with the eigenvalues of A - L C at ``poles``: the dual.

    With F in place of A it is the gain of a predictor, x_hat' = F x_hat + G u + L (y - C x_hat).

    Raises
    ------
    ValueError
        As `place`.
    DesignError
        If the readings do not see every mode, or see one too little.
    """
    hidden = uncontrollable_modes(A.T, C.T)
    if hidden.size:
        raise DesignError(f'poles: no reading sees the modes at {describe_distinct(hidden)}')
    dual = place(A.T, C.T, poles)
    return PlacementDesign(dual.gain.T, dual.poles)


def _checked(n: int, poles: Sequence[complex]) -> ComplexArray:
    try:
        wanted = np.atleast_1d(np.asarray(poles, dtype=np.complex128))
    except (TypeError, ValueError):
        got = type(poles).__name__
        raise ValueError(f'poles: expected {n} numbers, one a state, got {got}') from None
    if wanted.ndim > 1:
        raise ValueError(f'poles: expected {n} numbers, one a state, got shape {wanted.shape}')
    if wanted.shape != (n,) or not np.all(np.isfinite(wanted)):
        raise ValueError(f'poles: expected {n} finite numbers, one a state, got {poles}')
    if not np.allclose(np.sort_complex(wanted), np.sort_complex(wanted.conj())):
        raise ValueError(f'poles: expected every complex pole with its conjugate, got {poles}')
    return wanted
