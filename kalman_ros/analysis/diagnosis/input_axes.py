# SPDX-License-Identifier: Apache-2.0
"""Axes of the input that are exchanged, or rotated by the mounting of an instrument or motor.

If M u acts in the place of the input u, each step of the state has B (M - I) u added to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from math import degrees
from operator import attrgetter

import numpy as np

from kalman_ros.core import Array, Space, rotations
from kalman_ros.core.quantity import quantities

from .evidence import Evidence
from .examination import CHANCE, Examination
from .filter_pass import passage
from .finding import Finding
from .hypotheses import alike
from .mounting import best_near, nearest_rotation, plane_rotations, rotation_angle
from .passage import Passage
from .units import conversions

#: Smallest rotation that is a finding, in rad.
_SMALL = 0.03
#: Rotations about each axis at which a search by passes begins, in rad, the first steps of it,
#: and how it goes on.
_QUARTERS, _STEP = (0.5 * np.pi, np.pi, -0.5 * np.pi), 0.2
_SEARCH = {'maxfev': 60, 'xatol': 1e-3, 'fatol': 1.0}
#: Inputs that form vectors of two or three axes, which are turned together.
Vectors = Sequence[tuple[int, ...]]


def find(case: Examination) -> list[Finding]:
    """Return the exchanges and the rotations of the axes of the input that fit."""
    space = case.evidence.scenario.model.input
    planes = [[group] for group in alike(space) if len(group) == 2]
    findings = _find_exchange(case)
    for vectors in [*planes, *_instruments(space)]:
        turn = _likeliest_rotation(case, vectors)
        gain = _gain(case, _within(space, vectors, turn))
        if gain > CHANCE and abs(rotation_angle(turn)) > _SMALL:
            findings.append(_turned(case, vectors, turn, gain))
    return findings


def by_passes(
    case: Examination, until: float, misfit: Callable[[Passage], float] = attrgetter('misfit')
) -> Iterator[Finding]:
    """Yield the rotation of the input by which a lost filter follows the first seconds.

    Each trial is a pass up to the stamp ``until``, with a ``misfit``, since no linearisation
    holds.
    """
    from scipy.optimize import minimize  # slow import

    space = case.evidence.scenario.model.input
    for vectors in _instruments(space)[-1:]:

        def loss(turn: Array, vectors: Vectors = vectors) -> float:
            M = _within(space, vectors, rotations.exp(turn))
            return misfit(passage(mixed(case.evidence, M), until, strict=False))

        starts = [np.zeros(3), *(angle * axis for axis in np.eye(3) for angle in _QUARTERS)]
        start = min(starts, key=loss)
        simplex = {'initial_simplex': start + np.vstack((np.zeros(3), _STEP * np.eye(3)))}
        best = minimize(loss, start, method='Nelder-Mead', options={**_SEARCH, **simplex})
        turn = rotations.exp(best.x)
        if abs(rotation_angle(turn)) > _SMALL:
            yield _turned(case, vectors, turn, 0.0)


def multiplied(case: Examination, group: tuple[int, ...], factor: float) -> Finding:
    """Return the finding that a group of inputs acts as if multiplied by a factor of a unit."""
    space = case.evidence.scenario.model.input
    M = np.eye(space.size)
    M[group, group] = factor
    kind, why = 'input gain', f'it is in {conversions(space, group).get(factor, "another unit")}'
    if factor < 0.0:
        kind, why = 'input sign', 'it has the wrong sign'
    listed = ', '.join(space.names[i] for i in group)
    sentence = f'the input {listed} acts as if multiplied by {factor:.4g}: {why}.'
    return _finding(case, kind, space.names[group[0]], sentence, M, 0.0)


def mixed(evidence: Evidence, M: Array) -> Evidence:
    """Return the evidence with the inputs u replaced by M u."""
    return evidence.with_inputs(evidence.inputs.value @ M.T)


def _instruments(space: Space) -> list[Vectors]:
    """Return each vector of the input in space, and all, which one instrument may measure."""
    vectors = [group for group in alike(space) if len(group) == 3]
    return [*([vector] for vector in vectors), *([vectors] if len(vectors) > 1 else [])]


def _find_exchange(case: Examination) -> list[Finding]:
    """Return the best exchange of two inputs, if it is significant."""
    best = max(exchanges(case), key=lambda finding: finding.gain, default=None)
    return [] if best is None or best.gain < CHANCE else [best]


def exchanges(case: Examination) -> Iterator[Finding]:
    """Yield each exchange of two inputs, and of two axes of all vectors of an instrument."""
    space = case.evidence.scenario.model.input
    tried = [[pair] for group in alike(space) for pair in combinations(group, 2)]
    for vectors in _instruments(space):
        if len(vectors) > 1:
            tried += [[(v[i], v[j]) for v in vectors] for i, j in combinations(range(3), 2)]
    for pairs in tried:
        M = np.eye(space.size)
        for i, j in pairs:
            M[[i, j]] = M[[j, i]]
        listed = ', '.join(f'{space.names[i]} and {space.names[j]}' for i, j in pairs)
        sentence = f'the inputs {listed} are exchanged: each acts as the other.'
        yield _finding(case, 'input swapped', 'input', sentence, M, _gain(case, M))


def _likeliest_rotation(case: Examination, vectors: Vectors) -> Array:
    """Return the rotation of vectors of the input with the largest gain.

    The search is over a grid in the plane, or starts at the fitted rotation in space.
    """
    space = case.evidence.scenario.model.input

    def gain(turn: Array) -> float:
        return _gain(case, _within(space, vectors, turn))

    if len(vectors[0]) == 2:
        return max(plane_rotations(), key=gain)
    return best_near(nearest_rotation(np.eye(3) + _fitted_change(case, vectors)), gain)


def _fitted_change(case: Examination, vectors: Vectors) -> Array:
    """Return the fit of M - I (3, 3), of the matrix M by which all vectors are multiplied."""
    entries = list(product(range(3), repeat=2))
    columns = [_column(case, v[i], v[j]) for v in vectors for i, j in entries]
    if None in columns:
        return np.zeros((3, 3))
    basis = np.tile(np.eye(9), (len(vectors), 1))
    return case.responses.fit(basis, [c for c in columns if c is not None]).size.reshape(3, 3)


def _turned(case: Examination, vectors: Vectors, turn: Array, gain: float) -> Finding:
    """Return the finding that vectors of the input act as if rotated by ``turn``."""
    space, by = case.evidence.scenario.model.input, degrees(rotation_angle(turn))
    members = [space.names[i] for vector in vectors for i in vector]
    listed = '' if len(members) == space.size else f' {", ".join(members)}'
    sentence = f'the input{listed} acts as if turned by {by:+.3g} deg: its axes are others.'
    if len(turn) == 3 and quantities(case.evidence.scenario.input.fields):
        angles = ', '.join(f'{angle:.4g}' for angle in rotations.to_euler(rotations.log(turn)))
        sentence += f' If it is that of an instrument, input.mount.rotation: [{angles}] mends it.'

    def again(after: Examination) -> Finding:
        """Return the rotation with what is still to be turned after its correction."""
        return _turned(case, vectors, _likeliest_rotation(after, vectors) @ turn, gain)

    M = _within(space, vectors, turn)
    finding = _finding(case, 'input rotated', 'input', sentence, M, gain)
    return replace(finding, parameters=1 if len(turn) == 2 else 3, again=again)


def _finding(
    case: Examination, kind: str, subject: str, sentence: str, M: Array, gain: float
) -> Finding:
    evidence = case.evidence
    z = max(gain, 0.0) ** 0.5
    return Finding(kind, subject, sentence, z, gain=gain, mended=lambda: mixed(evidence, M))


def _within(space: Space, vectors: Vectors, turn: Array) -> Array:
    """Return the matrix that rotates vectors of an input."""
    M = np.eye(space.size)
    for vector in vectors:
        M[np.ix_(vector, vector)] = turn
    return M


def _column(case: Examination, acting: int, given: int) -> int | None:
    """Return the column of an input that acts where another one is given."""
    names = case.evidence.scenario.model.input.names
    label = ('gain', names[acting]) if acting == given else ('across', names[acting], names[given])
    return next(iter(case.responses.columns(*label)), None)


def _gain(case: Examination, M: Array) -> float:
    """Return the gain to first order if M u acts in the place of the input u."""
    change = M - np.eye(len(M))
    changed = [(int(i), int(j)) for i, j in np.argwhere(change)]
    columns = [_column(case, i, j) for i, j in changed]
    if None in columns:
        return 0.0
    at = [column for column in columns if column is not None]
    size = np.array([change[pair] for pair in changed])
    information = case.responses.information[np.ix_(at, at)]
    return float(2.0 * size @ case.responses.gradient[at] - size @ information @ size)
