# SPDX-License-Identifier: Apache-2.0
"""Axes of vector readings that are swapped, of another frame, or rotated by the mounting."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, permutations
from math import degrees, pi

import numpy as np

from kalman_ros.core import Array, Space, rotations
from kalman_ros.core.quantity import quantities, quantity
from kalman_ros.sensors.landmarks import Landmarks

from .alignment import aligned
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import alike
from .responses import Fit
from .units import label_of, mixed, mixing, replaced

#: Smallest rotation that is a finding, and largest difference from a quarter turn, in rad.
_SMALL, _NEAR = 0.01, 0.1
#: Most coordinates of which all orders are tried: 120 of five.
_FEW_AXES = 5


def find(case: Examination) -> list[Finding]:
    """Return the sensors whose readings fit after an exchange or a rotation of axes."""
    findings = []
    for name in case.judged:
        sensor = case.evidence.scenario.sensors[name].sensor
        space = sensor.output
        if space.size < 2 or not case.responses.columns('mix', name):
            continue
        findings += [*_find_swap(case, name, space.size), *_find_misaligned(case, name)]
        # ranges of several landmarks are no axes
        for group in () if isinstance(sensor, Landmarks) else vectors(space):
            findings += [*_find_rotation(case, name, group), *_find_crossed(case, name, group)]
    return findings


def vectors(space: Space) -> list[tuple[int, ...]]:
    """Return the groups of coordinates that form a vector of two or three axes."""
    # the coordinates of a rotation are not components of a vector
    turns = {index for turn in space.turns for index in range(turn.start, turn.stop)}
    return [group for group in alike(space) if len(group) <= 3 and not turns.intersection(group)]


def within(case: Examination, name: str, group: tuple[int, ...], turn: Array) -> Array:
    """Return the matrix that rotates one group of coordinates of a sensor by ``turn``."""
    M = np.eye(case.evidence.scenario.sensors[name].sensor.output.size)
    M[np.ix_(group, group)] = turn
    return M


def _gain_of(case: Examination, name: str, M: Array) -> float:
    return replaced(case, (name,), M)[0]


def _find_swap(case: Examination, name: str, size: int) -> list[Finding]:
    """Return the best exchange of axes, if one is significant."""
    unchanged = tuple(range(size))
    gains = {unchanged: CHANCE}

    def gain(order: tuple[int, ...]) -> float:
        if order not in gains:
            gains[order] = _gain_of(case, name, np.eye(size)[list(order)])
        return gains[order]

    if size <= _FEW_AXES:
        best = max(permutations(unchanged), key=gain)
    else:  # one exchange after the other, while the next one explains more
        best, following = unchanged, max(_exchanged(unchanged), key=gain)
        while gain(following) > gain(best):
            best, following = following, max(_exchanged(following), key=gain)
    return [] if best == unchanged else [axes_exchanged(case, name, best, gain(best))]


def _exchanged(order: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yield an order with each two exchanged."""
    for first, second in combinations(range(len(order)), 2):
        exchanged = [*order]
        exchanged[first], exchanged[second] = order[second], order[first]
        yield tuple(exchanged)


def axes_exchanged(case: Examination, name: str, order: tuple[int, ...], gain: float) -> Finding:
    """Return the finding that the axes of a sensor have another order."""
    names = case.evidence.scenario.sensors[name].sensor.output.names
    M = np.eye(len(order))[list(order)]
    exchanges = ', '.join(
        f'{names[i]} is read as {names[j]}' for i, j in enumerate(order) if i != j
    )
    fields = case.evidence.scenario.sensors[name].signal.fields
    change = {f'{name}.fields': [fields[j] for j in order]} if fields else {}
    return Finding(
        'swapped', name, f'axes of {name} are swapped: {exchanges}. Exchange its fields.',
        gain**0.5, change, gain=gain, figure=_picture(case, name, M),
        mended=lambda: mixed(case.evidence, name, M),
    )  # fmt: skip


def from_north(case: Examination, name: str, index: int) -> Finding:
    """Return the finding that an angle counts clockwise from north, without its gain."""
    space = case.evidence.scenario.sensors[name].sensor.output
    turned, label = case.evidence.sensors[name].value.copy(), f'{name}.{space.names[index]}'
    turned[:, index] = 0.5 * pi - turned[:, index]
    return Finding(
        'swapped', label,
        f'{label} is pi/2 less the angle of the model: it counts from the other axis, and the '
        'other way, as a heading clockwise from north does, where REP-103 counts from east to '
        'north. Publish pi/2 less this angle.',
        0.0, mended=lambda: case.evidence.with_values(name, space.wrap(turned)),
    )  # fmt: skip


def blocks_exchanged(case: Examination, name: str) -> Iterator[Finding]:
    """Yield the exchanges of two parts of a sensor that read the same, such as two beacons."""
    units = case.evidence.scenario.sensors[name].sensor.output.units
    size = len(units)
    lengths = (k for k in range(1, size) if size % k == 0 and units == units[:k] * (size // k))
    block = next(lengths, size)
    parts = [tuple(range(first, first + block)) for first in range(0, size, block)]
    for order in _exchanged(tuple(range(len(parts)))):
        whole = tuple(index for part in order for index in parts[part])
        yield axes_exchanged(case, name, whole, 0.0)


def _find_rotation(case: Examination, name: str, group: tuple[int, ...]) -> list[Finding]:
    """Return the best rotation of a group of two or three axes, if it is significant."""
    turn = best_rotation(case, name, group)
    gain = _gain_of(case, name, within(case, name, group, turn))
    if gain < CHANCE or abs(rotation_angle(turn)) < _SMALL:
        return []
    residual = case.passage.misfit - gain
    sentence = f'Misfit {case.passage.misfit:.4g} becomes {residual:.4g}.'
    return [turned(case, name, group, turn, gain, sentence)]


def turned(
    case: Examination, name: str, group: tuple[int, ...], turn: Array, gain: float, residual: str
) -> Finding:
    """Return the finding that a group of coordinates fits after a rotation by ``turn``.

    ``residual`` is a sentence about the remaining misfit.
    """
    angle, M, label = (
        rotation_angle(turn),
        within(case, name, group, turn),
        label_of(case, name, group),
    )
    quarter = abs(abs(angle) - 0.5 * np.pi) < _NEAR
    why = (
        ' A quarter turn is what east-north-up leaves in place of north-east-down.'
        if quarter
        else ''
    )
    if len(turn) == 3 and quantities(case.evidence.scenario.sensors[name].signal.fields):
        angles = ', '.join(f'{euler:.4g}' for euler in rotations.to_euler(rotations.log(turn)))
        why += f' If it is a vector of the body, {name}.mount.rotation: [{angles}] says the same.'
    return Finding(
        'rotated',
        label,
        f'readings of {label} fit once turned by {degrees(angle):+.3g} deg: it is mounted '
        f'at an angle, or its frame is another one.{why} {residual}',
        gain**0.5,
        mixing(case.evidence, name, M),
        gain=gain,
        figure=_picture(case, name, M, group),
        mended=lambda: mixed(case.evidence, name, M),
    )


def _find_misaligned(case: Examination, name: str) -> list[Finding]:
    """Return the finding that a sensor is turned as a whole, if it is significant."""
    fit = _tilt(case, name)
    if fit is None or fit.gain < CHANCE:
        return []
    return [_misaligned(case, name, rotations.exp(fit.size), fit)]


def _tilt(case: Examination, name: str) -> Fit | None:
    """Return the fit of a turn of all vectors and attitudes of a sensor, in rad (3,)."""
    columns = case.responses.columns('turn', name)
    return case.responses.fit(np.eye(3), columns) if columns else None


def _misaligned(case: Examination, name: str, turn: Array, fit: Fit) -> Finding:
    """Return the finding that all vectors and attitudes of a sensor fit after a ``turn``."""
    evidence, source = case.evidence, case.evidence.scenario.sensors[name]
    known = evidence.scenario.sensors[name].signal.mounting
    B = turn @ rotations.exp(rotations.from_euler(np.array(known.rotation)))
    angles = [round(float(angle), 4) for angle in rotations.to_euler(rotations.log(B))]
    change = {f'{name}.mount.rotation': angles}
    try:
        evidence.adopting(change)
    except ValueError:
        change = {}
    record = evidence.sensors[name]

    def mended() -> Evidence:
        return evidence.with_values(name, aligned(source.signal.fields, record.value, turn))

    def again(after: Examination) -> Finding | None:
        more = _tilt(after, name)
        if more is None or not more.remains:
            return None
        return _misaligned(case, name, rotations.exp(more.size) @ turn, replace(more, gain=0.0))

    words = ', '.join(
        f'{degrees(angle):+.3g} ± {degrees(std):.1g} deg about {axis}'
        for angle, std, axis in zip(rotations.log(turn), fit.std, 'xyz')
    )
    return Finding(
        'rotated', name,
        f'readings of {name} fit once all of its axes are turned: {words}. It is mounted at an '
        f'angle, {name}.mount.rotation: {angles}.',
        fit.gain**0.5, change, gain=fit.gain, parameters=3, mended=mended, again=again,
    )  # fmt: skip


def _find_crossed(case: Examination, name: str, group: tuple[int, ...]) -> list[Finding]:
    """Return the axis of a vector that reads a part of another one most significantly."""
    fields = case.evidence.scenario.sensors[name].signal.fields
    owners = [read and (read.owner, read.names) for read in map(quantity, fields)]
    fits = {
        (i, j): _crossing(case, name, i, j)
        for i, j in permutations(group, 2)
        if owners[i] is not None and owners[i] == owners[j]
    }
    if not fits:
        return []
    (i, j), fit = max(fits.items(), key=lambda item: item[1].gain)
    if fit.gain < CHANCE or abs(float(fit.size[0])) < _SMALL:
        return []
    return [_crossed(case, name, i, j, float(fit.size[0]), fit)]


def _crossing(case: Examination, name: str, i: int, j: int) -> Fit:
    """Return the fit of the share of axis j that axis i reads."""
    return case.responses.fit(np.ones((1, 1)), case.responses.columns('mix', name, str(i), str(j)))


def _crossed(case: Examination, name: str, i: int, j: int, share: float, fit: Fit) -> Finding:
    """Return the finding that axis i of a sensor reads a share of axis j, too."""
    M = np.eye(case.evidence.scenario.sensors[name].sensor.output.size)
    M[i, j] = -share
    names = case.evidence.scenario.sensors[name].sensor.output.names

    def again(after: Examination) -> Finding | None:
        more = _crossing(after, name, i, j)
        size = share + float(more.size[0])
        return _crossed(case, name, i, j, size, replace(more, gain=fit.gain))

    return Finding(
        'cross-axis', name,
        f'{names[i]} of {name} reads {share:+.4g} ± {fit.std[0]:.1g} of {names[j]}, too: its axes '
        'are not perpendicular, or one couples into the other.',
        fit.gain**0.5, mixing(case.evidence, name, M), gain=fit.gain,
        figure=_picture(case, name, M, (i, j)), mended=lambda: mixed(case.evidence, name, M),
        again=again,
    )  # fmt: skip


def rotation_angle(M: Array) -> float:
    """Return the angle of a rotation; in the plane, it has a sign."""
    if len(M) == 2:
        return float(np.arctan2(M[1, 0], M[0, 0]))
    return float(np.arccos(np.clip(0.5 * (np.trace(M) - 1.0), -1.0, 1.0)))


def best_rotation(case: Examination, name: str, group: tuple[int, ...]) -> Array:
    """Return the rotation with the largest gain.

    The search is over a grid in the plane, or starts at the fitted rotation in space.
    """

    def gain(turn: Array) -> float:
        return _gain_of(case, name, within(case, name, group, turn))

    if len(group) == 2:
        return max(plane_rotations(), key=gain)
    pairs = [(str(i), str(j)) for i in group for j in group]
    columns = [at for pair in pairs for at in case.responses.columns('mix', name, *pair)]
    fit = case.responses.together(columns)
    return best_near(nearest_rotation(np.eye(3) - fit.size.reshape(3, 3)), gain)


def best_near(start: Array, gain: Callable[[Array], float]) -> Array:
    """Return the rotation in space with the largest gain, by a search from ``start``."""
    from scipy.optimize import minimize  # slow import

    best = minimize(lambda turn: -gain(rotations.exp(turn) @ start), np.zeros(3), method='BFGS')
    return np.asarray(rotations.exp(best.x) @ start)


def plane_rotations() -> list[Array]:
    """Return rotations (2, 2) by every half degree."""
    angles = np.linspace(-np.pi, np.pi, 721)
    return [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angles]


def nearest_rotation(M: Array) -> Array:
    """Return the rotation (k, k) nearest to a matrix.

    It is the rotation of the polar decomposition (P. Schoenemann, A Generalized Solution of the
    Orthogonal Procrustes Problem, Psychometrika 31(1), 1966).
    """
    U, _, V = np.linalg.svd(M)
    return np.asarray(U @ np.diag([*np.ones(len(M) - 1), np.linalg.det(U @ V)]) @ V)


def _picture(case: Examination, name: str, M: Array, group: tuple[int, ...] = (0, 1)) -> Figure:
    record, (i, j) = case.evidence.sensors[name], group[:2]
    names = case.evidence.scenario.sensors[name].sensor.output.names
    mended = record.value @ M.T
    curves = (
        Curve('as read', record.value[:, i], record.value[:, j], 'dots'),
        Curve('corrected', mended[:, i], mended[:, j], 'dots'),
    )
    return Figure(f'{name}: its axes', names[i], names[j], curves)
