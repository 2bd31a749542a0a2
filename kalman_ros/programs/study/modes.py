# SPDX-License-Identifier: Apache-2.0
"""A linear system moves by exp(A t): directions that keep, times exponentials of eigenvalues.

The plant's own step is repeated and compared with the power series and with T exp(Λ t) T^-1, of a
node, a spiral and a matrix with one eigenvector only. No noise and no loop, so no nodes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array

from . import Findings, between, close, largest
from .systems import linear, plant

#: Two real eigenvalues, with directions that are not at right angles.
DIRECTIONS = np.array([[1.0, 1.0], [0.5, -1.0]])
NODE = DIRECTIONS @ np.diag([-0.5, -2.0]) @ np.linalg.inv(DIRECTIONS)
#: A complex pair, -0.3 +- 3j: a mass on a spring.
DECAY, FREQUENCY = 0.3, 3.0
SPIRAL = np.array([[0.0, 1.0], [-(DECAY**2) - FREQUENCY**2, -2.0 * DECAY]])
#: -1 twice, and one direction.
DEFECTIVE = np.array([[-1.0, 1.0], [0.0, -1.0]])
SYSTEMS = {'node': NODE, 'spiral': SPIRAL, 'defective': DEFECTIVE}
DT, STEPS, LATER = 0.01, 800, 2.0
#: Rounding of matrices with entries of order 1, after two hundred products.
ROUNDING = 1e-12


def study(size: float = 1.0) -> Findings:
    """Compare three ways to compute exp(A t); the size has no effect."""
    checks: list[Check] = []
    for name, A in SYSTEMS.items():
        moved = path(A, np.eye(2))[round(LATER / DT)].T
        off = largest(by_series(A, LATER, 60) - moved)
        checks.append(close(f'{name}: series, off by', '', 0.0, off, ROUNDING))
        missed = LATER * np.exp(-LATER) if name == 'defective' else 0.0
        off = largest(by_diagonalisation(A, LATER) - moved)
        checks.append(close(f'{name}: diagonalisation, off by', '', missed, off, ROUNDING))
    checks += [*_directions(), *_oscillation(), *_defective()]
    return Findings(checks, _draw)


def by_series(A: Array, t: float, terms: int) -> Array:
    """Return the sum of (A t)^k / k! over k < ``terms``."""
    total = term = np.eye(len(A))
    for k in range(1, terms):
        term = term @ A * (t / k)
        total = total + term
    return total


def by_diagonalisation(A: Array, t: float) -> Array:
    """Return T exp(Λ t) T^-1, with the eigenvectors in the columns of T."""
    poles, T = np.linalg.eig(A)
    return np.asarray((T * np.exp(poles * t) @ np.linalg.inv(T)).real)


def path(A: Array, x: Array) -> Array:
    """Return the states (N + 1, ..., n) of the plant from ``x`` (..., n), step by step."""
    system = plant(
        linear({'x': '', 'v': ''}, A, np.zeros((2, 1)), np.zeros(2), np.eye(2), [1.0] * 2)
    )
    states = [x]
    for _ in range(STEPS):
        states.append(system.step(states[-1], np.zeros(1), DT))
    return np.array(states)


def _directions() -> list[Check]:
    """Start on an eigenvector: the state keeps its line, and shrinks by the eigenvalue alone."""
    checks = []
    for pole, along in zip((-0.5, -2.0), DIRECTIONS.T):
        states = path(NODE, along)
        aside = states @ np.array([-along[1], along[0]]) / np.linalg.norm(along) ** 2
        rate = np.polyfit(DT * np.arange(len(states)), np.log(states @ along), 1)[0]
        off = largest(aside)
        checks.append(close(f'node: leaves the line of {pole:g} by', '', 0.0, off, ROUNDING))
        checks.append(close(f'node: rate on the line of {pole:g}', '1/s', pole, rate, 1e-6))
    return checks


def _oscillation() -> list[Check]:
    """Compare frequency and decay of an oscillation with its complex pair."""
    v = path(SPIRAL, np.array([1.0, 0.0]))[:, 1]
    turns = _zeros(v)
    period = 2.0 * float(np.mean(np.diff(turns)))
    x = path(SPIRAL, np.array([1.0, 0.0]))[:, 0]
    peaks = np.abs(np.interp(turns, DT * np.arange(len(x)), x))
    decay = float(np.mean(np.diff(np.log(peaks)) / np.diff(turns)))
    # straight lines between samples miss a sine by (FREQUENCY DT)^2 / 8
    error = (FREQUENCY * DT) ** 2 / 8.0
    return [
        close('spiral: frequency', 'rad/s', FREQUENCY, 2.0 * np.pi / period, FREQUENCY * error),
        close('spiral: decay of its peaks', '1/s', -DECAY, decay, FREQUENCY * error),
    ]


def _zeros(values: Array) -> Array:
    """Return the times (N,) after the start where a sampled signal changes its sign."""
    k = 1 + np.flatnonzero(values[1:-1] * values[2:] < 0.0)
    return np.asarray(DT * (k + values[k] / (values[k] - values[k + 1])))


def _defective() -> list[Check]:
    """Compare the solution beside the only eigenvector with t exp(-t), which grows first."""
    x = path(DEFECTIVE, np.array([0.0, 1.0]))[:, 0]
    poles, T = np.linalg.eig(DEFECTIVE)
    apart = float(np.abs(np.linalg.det(T)))
    return [
        close('defective: largest x, from x = 0', '', np.exp(-1.0), float(x.max()), DT**2),
        close('defective: reached after', 's', 1.0, DT * int(np.argmax(x)), DT),
        between('defective: angle between its directions', 'rad', 0.0, apart, 1e-12),
        close('defective: distance of its eigenvalues', '1/s', 0.0, abs(np.ptp(poles)), 1e-12),
    ]


def _draw(picture: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with, shades

    time = DT * np.arange(STEPS + 1)
    with figure_with(picture, 2, 2, (9.0, 6.2)) as (_, ((node, spiral), (defective, series))):
        for along, label in zip(DIRECTIONS.T, ('-0.5 1/s', '-2 1/s')):
            node.axline((0, 0), along, color=INPUT, lw=1.0, ls='-' if along[1] > 0 else '--',
                        label=f'eigenvector of {label}')  # fmt: skip
        for angle in np.arange(12) * np.pi / 6:
            x, v = path(NODE, np.array([np.cos(angle), np.sin(angle)])).T
            node.plot(x, v, color=ESTIMATE, lw=0.9)
            node.plot(x[0], v[0], 'o', color=ESTIMATE, ms=3)
        node.set(title='Real eigenvalues: two lines that keep', xlabel='x', ylabel='v',
                 xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), aspect='equal')  # fmt: skip
        node.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize=7)
        x = path(SPIRAL, np.array([1.0, 0.0]))[:, 0]
        spiral.plot(time, x, color=TRUTH, label='x by the plant')
        for sign in (1.0, -1.0):
            spiral.plot(time, sign * np.exp(-DECAY * time), '--', color=INPUT, lw=1.0,
                        label='exp(-0.3 t)' if sign > 0 else None)  # fmt: skip
        spiral.set(title='A complex pair: -0.3 ± 3j 1/s', xlabel='time [s]', ylabel='x')
        spiral.legend(loc='upper right')
        grown = path(DEFECTIVE, np.array([0.0, 1.0]))[:, 0]
        split = [by_diagonalisation(DEFECTIVE, t)[0, 1] for t in time]
        defective.plot(time, grown, color=TRUTH, label='x by the plant: t exp(-t)')
        defective.plot(time, split, '--', color=INPUT, label='T exp(Λ t) T⁻¹: misses it')
        defective.set(title='-1 1/s twice, with one eigenvector', xlabel='time [s]', ylabel='x')
        defective.legend(loc='upper right')
        terms = range(1, 90)
        for t, colour in zip((1.0, 3.0, 8.0), shades(3)):
            exact = by_diagonalisation(SPIRAL, t)
            off = [largest(by_series(SPIRAL, t, k) - exact) for k in terms]
            series.semilogy(terms, np.maximum(off, 1e-17), color=colour, label=f't = {t:g} s')
        series.axhline(np.finfo(float).eps, color=READING, lw=0.8, ls=':')
        series.set(title='The series of the spiral: terms and digits', xlabel='terms',
                   ylabel='largest error')  # fmt: skip
        series.legend(loc='upper right')
