# SPDX-License-Identifier: Apache-2.0
"""Readings in another unit, of another scale, or with the wrong sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log, pi
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario.parameter_files import section
from kalman_ros.sensors import options

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding

_LENGTH, _SPEED, _ANGLE, _TURN = ('m',), ('m/s',), ('rad', 'rad/s'), ('rad/s',)
_DEGREES, _ACCELERATION = ('deg', 'deg/s'), ('m/s^2',)
#: What a reading is multiplied by to be in the model's unit, what it is in then, and which units
#: the model can have; none: any.
UNITS: dict[float, tuple[str, tuple[str, ...]]] = {
    pi / 180.0: ('degrees', _ANGLE),
    180.0 / pi: ('radians, where degrees are expected', _DEGREES),
    1.0 / 3.6: ('km/h', _SPEED),
    3.6: ('m/s, where km/h are expected', ('km/h',)),
    1e-3: ('thousandths (mm, mm/s)', ()),
    1e3: ('thousands (km)', ()),
    1e-2: ('hundredths (cm, cm/s)', (*_LENGTH, *_SPEED)),
    1e2: ('metres, where centimetres are expected', ('cm', 'cm/s')),
    0.3048: ('feet', _LENGTH),
    1.0 / 0.3048: ('metres, where feet are expected', ('ft',)),
    0.44704: ('miles an hour', _SPEED),
    9.80665: ('g', _ACCELERATION),
    1.0 / 9.80665: ('m/s^2, where g are expected', ('g',)),
    2.0 * pi / 60.0: ('revolutions a minute', _TURN),
    2.0 * pi: ('turns', _ANGLE),
}
#: A unit that the fit does not name must explain this part of the misfit.
_EXPLAINED = 0.5
#: Two scales are one within this, relative, and scales within it of 1 are no finding.
_CLOSE, _RELEVANT = 0.05, 0.05


def find(case: Examination) -> list[Finding]:
    """Return the sensors, and coordinates of one, that fit once multiplied by a factor."""
    found = []
    for name in case.evidence.sensors:
        for group in groups(case.evidence.scenario.sensors[name].sensor.output):
            columns = [case.responses.columns('mix', name, str(i), str(i)) for i in group]
            if not all(columns):
                continue
            basis = np.ones((len(group), 1))
            fit = case.responses.fit(basis, [column for each in columns for column in each])
            factor, std = 1.0 - float(fit.size[0]), float(fit.std[0])
            relevant = abs(factor - 1.0) > max(_RELEVANT, 4.0 * std)
            if fit.gain > CHANCE * _inflation(case, name) and relevant:
                factor, std = _likeliest(case, name, group, factor, std)
                found.append(scaled(case, name, group, factor, std, fit.gain))
    return found


def groups(space: Space) -> list[tuple[int, ...]]:
    """Return the coordinates that may share a factor: each alone, and all of one unit together."""
    return [*((index,) for index in range(space.size)), *alike(space)]


def alike(space: Space) -> list[tuple[int, ...]]:
    """Return the groups of two or more coordinates that have the same unit."""
    found: dict[str, list[int]] = {}
    for index, unit in enumerate(space.units):
        found.setdefault(unit, []).append(index)
    return [tuple(group) for group in found.values() if len(group) > 1]


def label_of(case: Examination, name: str, group: Sequence[int]) -> str:
    """Return a sensor's name, with those of its coordinates if they are not all."""
    names = case.evidence.scenario.sensors[name].sensor.output.names
    if len(group) == len(names) > 1:
        return name
    return f'{name}.{",".join(names[index] for index in group)}'


def _inflation(case: Examination, name: str) -> float:
    """Return by how much innovations squared are larger than expected, outliers aside."""
    squares = [case.passage.whitened[i] @ case.passage.whitened[i] for i in case.passage.of(name)]
    size = case.evidence.scenario.sensors[name].sensor.output.size
    return max(1.0, float(np.median(squares)) / size) if squares else 1.0


def _likeliest(
    case: Examination, name: str, group: tuple[int, ...], factor: float, std: float
) -> tuple[float, float]:
    """Return the likelier of the fitted factor and those of units and of a wrong sign.

    Where readings are far off, the prediction that the factor is fitted to is far off as well.
    """

    def gain(trial: float) -> float:
        return replaced(case, name, scaling(case, name, group, trial))[0]

    if abs(factor) < 1e-6:
        factor = 1e-6
    best = max((-1.0, *conversions(case, name, group)), key=gain)
    excess = sum(float(e @ e) - len(e) for e in case.passage.whitened)
    likelier = gain(best) > max(gain(factor), _EXPLAINED * excess)
    return (best, 0.0) if likelier else (factor, std)


def conversions(case: Examination, name: str, group: tuple[int, ...]) -> list[float]:
    """Return the factors of `UNITS` that make sense for the units of some coordinates."""
    space = case.evidence.scenario.sensors[name].sensor.output
    own = {space.units[index] for index in group}
    return [factor for factor, (_, units) in UNITS.items() if not units or own <= {'', *units}]


def scaling(case: Examination, name: str, group: tuple[int, ...], factor: float) -> Array:
    """Return the matrix (k, k) that multiplies some coordinates by a factor."""
    M = np.eye(case.evidence.scenario.sensors[name].sensor.output.size)
    M[group, group] = factor
    return M


def replaced(case: Examination, name: str, M: Array) -> tuple[float, float]:
    """Return the gain if the readings y of a sensor become M y, to first order, and its dues.

    The density of y is that of M y times |det M|, so that to make readings small is no gain: dues
    are -2 log |det M| for each reading.
    """
    columns = case.responses.columns('read', name)
    size = (np.eye(len(M)) - M).ravel()
    information = case.responses.information[np.ix_(columns, columns)]
    gain = float(2.0 * size @ case.responses.gradient[columns] - size @ information @ size)
    dues = -2.0 * len(case.passage.of(name)) * float(np.linalg.slogdet(M)[1])
    return gain - dues, dues


def scaled(
    case: Examination, name: str, group: tuple[int, ...], factor: float, std: float, gain: float
) -> Finding:
    """Return the finding that some coordinates must be multiplied by a ``factor``."""
    evidence = case.evidence
    space, index = evidence.scenario.sensors[name].sensor.output, group[0]
    label = label_of(case, name, group)
    kind, factor, why = _named(factor, std, conversions(case, name, group))
    M = scaling(case, name, group, factor)
    exact, dues = replaced(case, name, M)
    record = evidence.sensors[name]
    when = record.stamp - evidence.start
    curves = (
        Curve('as read', when, record.value[:, index], 'dots'),
        Curve(f'times {factor:.4g}', when, factor * record.value[:, index], 'line'),
    )
    return Finding(
        kind, label, f'readings of {label} fit the model once multiplied by {factor:.4g}{why}.',
        gain**0.5, mixing(evidence, name, M), gain=max(gain, exact), dues=dues,
        figure=Figure(f'{label}: scale', 'time [s]', space.names[index], curves),
        mended=lambda: mixed(evidence, name, M),
    )  # fmt: skip


def _named(factor: float, std: float, conversions: Sequence[float]) -> tuple[str, float, str]:
    """Return the kind of a factor, the one of a unit or a sign if it is near, and why."""
    if factor < 0.0:
        if abs(factor + 1.0) < max(0.35, 4.0 * std):
            return 'sign', -1.0, ': they have the wrong sign'
        return 'sign', factor, f' +- {std:.1g}: they have the wrong sign, and another scale'
    near = min(conversions, key=lambda unit: abs(log(factor / unit)))
    close = max(_CLOSE, min(4.0 * std / factor, 0.25))
    if factor > 0.0 and abs(log(factor / near)) < close:
        return 'unit', near, f': they are in {UNITS[near][0]}'
    return 'scale', factor, f' +- {std:.1g}: their scale is wrong'


def mixed(evidence: Evidence, name: str, M: Array) -> Evidence:
    """Return the evidence with the readings y of a sensor replaced by M y."""
    record = evidence.sensors[name]
    return evidence.with_sensor(name, replace(record, value=record.value @ M.T))


def mixing(evidence: Evidence, name: str, M: Array) -> dict[str, Any]:
    """Return the parameters by which a linear sensor reads M^-1 C x; empty if there are none.

    The noise stays that of the right unit: it is multiplied in the same way.
    """
    scenario, given = evidence.scenario, section(evidence.parameters, name)
    sensor = scenario.sensors[name].sensor
    if not sensor.linear or sensor.output.angles or abs(np.linalg.det(M)) < 1e-12:
        return {}
    inverse = np.linalg.inv(M)
    C = inverse @ sensor.jacobian(np.zeros(scenario.model.state.size))
    noise = np.sqrt(np.maximum((inverse @ sensor.covariance @ inverse.T).diagonal(), 0.0))
    own = {option.name for option in options(str(given.get('kind', 'states')))}
    removed = own.intersection(given) - {option.name for option in options('linear')}
    return {
        **{f'{name}.{key}': None for key in sorted(removed)},
        f'{name}.kind': 'linear',
        f'{name}.C': [float(f'{each:.6g}') for each in C.ravel()],
        f'{name}.names': list(sensor.output.names),
        f'{name}.noise': [float(f'{each:.4g}') for each in noise],
    }
