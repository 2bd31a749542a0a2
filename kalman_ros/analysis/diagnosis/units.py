# SPDX-License-Identifier: Apache-2.0
"""Readings with the wrong unit, scale or sign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from math import log, pi
from typing import Any

import numpy as np

from kalman_ros.core import Array, Space
from kalman_ros.scenario.parameter_files import section
from kalman_ros.sensors import options

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import alike
from .responses import Fit, fitted

_LENGTH, _SPEED, _ANGLE, _TURN = ('m',), ('m/s',), ('rad', 'rad/s'), ('rad/s',)
_DEGREES, _ACCELERATION, _PRESSURE = ('deg', 'deg/s'), ('m/s^2',), ('Pa',)
_FIELD = ('T',)
#: Factor from the unit of a reading to the unit of the model, the unit of the reading, and the
#: units that the model can have (empty for any unit).
UNITS: Sequence[tuple[float, str, tuple[str, ...]]] = (
    (pi / 180.0, 'degrees', _ANGLE),
    (180.0 / pi, 'radians, where degrees are expected', _DEGREES),
    (1.0 / 3.6, 'km/h', _SPEED),
    (3.6, 'm/s, where km/h are expected', ('km/h',)),
    (1e-3, 'thousandths (mm, mm/s)', ()),
    (1e3, 'thousands (km, kPa)', ()),
    (1e-2, 'hundredths (cm, cm/s)', (*_LENGTH, *_SPEED)),
    (1e2, 'metres, where centimetres are expected', ('cm', 'cm/s')),
    (1e2, 'hPa (millibars)', _PRESSURE),
    (1e4, 'dbar', _PRESSURE),
    (133.322, 'mm of mercury', _PRESSURE),
    (3386.39, 'inches of mercury', _PRESSURE),
    (1e5, 'bar', _PRESSURE),
    (6894.757, 'pounds a square inch', _PRESSURE),
    (1e-4, 'gauss', _FIELD),
    (1e-6, 'microtesla', _FIELD),
    (0.3048, 'feet', _LENGTH),
    (0.3048, 'feet a second', _SPEED),
    (1852.0, 'nautical miles', _LENGTH),
    (1609.344, 'miles', _LENGTH),
    (0.0254, 'inches', _LENGTH),
    (1.0 / 0.0254, 'metres, where inches are expected', ('in',)),
    (1.0 / 0.3048, 'metres, where feet are expected', ('ft',)),
    (0.44704, 'miles an hour', _SPEED),
    (0.514444, 'knots', _SPEED),
    (9.80665, 'g', _ACCELERATION),
    (1.0 / 9.80665, 'm/s^2, where g are expected', ('g',)),
    (2.0 * pi / 60.0, 'revolutions a minute', _TURN),
    (2.0 * pi, 'turns', _ANGLE),
)
#: Scale and zero of readings of a temperature, by what they are in.
AFFINE = {
    'degrees Fahrenheit': (1.0 / 1.8, -32.0 / 1.8),
    'kelvin, where degrees Celsius are expected': (1.0, -273.15),
    'degrees Celsius, where kelvin are expected': (1.0, 273.15),
}
#: Units of a temperature.
_TEMPERATURE = ('', 'K', 'C', 'degC')
#: Factors that are likelier than a unit: a radius for a diameter, edges that are counted twice.
_PLAIN = (0.5, 2.0)
#: A unit that differs from the fitted factor must explain this share of the misfit, and so must
#: another factor, whose logarithm differs by more than the second number, where innovations are
#: larger than expected by the third share.
_EXPLAINED, _FAR, _MISFIT = 0.5, 0.25, 0.2
#: A temperature in another unit has this share of the gain of the best scale and zero.
_SAME = 0.98
#: Two factors are equal if their relative difference is below the first number. A factor that
#: differs from 1 by less than the second number is no finding.
_CLOSE, _RELEVANT = 0.05, 0.003
#: Two scales of a coordinate, above and below zero, that differ by less are no finding.
_UNEVEN = 0.03
#: Least share of the squares of readings on either side of zero.
_BOTH = 0.1


def find(case: Examination) -> list[Finding]:
    """Return the sensors and coordinates that fit after a multiplication by a factor."""
    findings = []
    for name in case.judged:
        output = case.evidence.scenario.sensors[name].sensor.output
        whole = tuple(range(output.size))
        for group in dict.fromkeys((*groups(output), whole)):
            fit = share(case, (name,), group)
            if fit is None:
                continue
            factor, std = 1.0 - float(fit.size[0]), float(fit.std[0])
            relevant = abs(factor - 1.0) > max(_RELEVANT, 4.0 * std)
            if fit.gain > CHANCE * _inflation(case, name) and relevant:
                factor, std = _likeliest_factor(case, name, group, factor, std)
                findings.append(scaled(case, (name,), group, factor, std, fit.gain))
        findings += _temperatures(case, name)
        findings += _asymmetries(case, name)
    return findings


def _asymmetries(case: Examination, name: str) -> list[Finding]:
    """Return the coordinates with another scale where they are negative."""
    findings, record = [], case.evidence.sensors[name]
    for index in range(record.value.shape[1]):
        columns = [
            *case.responses.columns('mix', name, str(index), str(index)),
            *case.responses.columns('upper', name, str(index)),
        ]
        y = record.value[np.isfinite(record.value[:, index]), index]
        either = min(float(np.sum(np.maximum(side, 0.0) ** 2)) for side in (y, -y))
        if len(columns) < 2 or either < _BOTH * float(np.sum(y**2)):
            continue
        fit = case.responses.fit(np.eye(2), columns)
        factors = 1.0 - float(fit.size.sum()), 1.0 - float(fit.size[0])
        differ = abs(factors[0] - factors[1]) > max(_UNEVEN, 4.0 * float(fit.std[1]))
        if fit.gain >= CHANCE and min(factors) > 0.0 and differ:
            findings.append(_asymmetric(case, name, index, factors, fit.gain))
    return findings


def _asymmetric(
    case: Examination, name: str, index: int, factors: tuple[float, float], gain: float
) -> Finding:
    """Return the finding of a coordinate with these factors above zero, and below."""
    y, label = case.evidence.sensors[name].value[:, index], label_of(case, name, (index,))
    return Finding(
        'asymmetric scale', label,
        f'readings of {label} fit the model once multiplied by {factors[0]:.4g} where they are '
        f'positive, and by {factors[1]:.4g} where they are negative.',
        gain**0.5, gain=gain, parameters=2,
        mended=lambda: case.evidence.with_column(name, index, y * np.where(y > 0.0, *factors)),
    )  # fmt: skip


def _temperatures(case: Examination, name: str) -> list[Finding]:
    """Return the coordinates that are a temperature in another unit, with another zero.

    As `replaced`, of which the correction is M y + b.
    """
    findings, responses = [], case.responses
    space = case.evidence.scenario.sensors[name].sensor.output
    for index in (i for i, unit in enumerate(space.units) if unit in _TEMPERATURE):
        scale = responses.columns('read', name, str(index), str(index))
        columns = [*scale, *responses.columns('offset', name, str(index))]
        basis = np.zeros((len(columns), 2))
        basis[: len(scale), 0] = basis[len(scale) :, 1] = 1.0
        gradient = basis.T @ responses.gradient[columns]
        information = basis.T @ responses.information[np.ix_(columns, columns)] @ basis
        for unit, (factor, zero) in AFFINE.items():
            size = np.array([1.0 - factor, -zero])
            dues = -2.0 * len(case.passage.of(name)) * log(factor)
            gain = float(2.0 * size @ gradient - size @ information @ size) - dues
            likeliest = fitted(gradient, information).gain
            if gain > CHANCE and gain > _SAME * likeliest:
                findings.append(_temperature(case, name, index, unit, gain, dues))
    return findings


def _temperature(
    case: Examination, name: str, index: int, unit: str, gain: float, dues: float
) -> Finding:
    """Return the finding that a coordinate is a temperature in another unit."""
    y, (factor, zero) = case.evidence.sensors[name].value[:, index], AFFINE[unit]
    label = label_of(case, name, (index,))
    return Finding(
        'unit', label,
        f'readings of {label} fit the model once multiplied by {factor:.4g} and moved by '
        f'{zero:+.4g}: they are in {unit}.',
        gain**0.5, gain=gain, dues=dues,
        mended=lambda: case.evidence.with_column(name, index, factor * y + zero),
    )  # fmt: skip


def share(case: Examination, names: Sequence[str], group: Sequence[int]) -> Fit | None:
    """Return the fit of by how much coordinates of some sensors are too large, as a share."""
    by_coordinate = [
        case.responses.columns('mix', name, str(i), str(i)) for name in names for i in group
    ]
    if not all(by_coordinate):
        return None
    together = [column for columns in by_coordinate for column in columns]
    return case.responses.fit(np.ones((len(together), 1)), together)


def groups(space: Space) -> list[tuple[int, ...]]:
    """Return the groups that may share a factor: each coordinate, and all of the same unit."""
    return [*((index,) for index in range(space.size)), *alike(space)]


def label_of(case: Examination, name: str, group: Sequence[int]) -> str:
    """Return the name of a sensor, with the names of coordinates unless the group has all."""
    names = case.evidence.scenario.sensors[name].sensor.output.names
    if len(group) == len(names) > 1:
        return name
    return f'{name}.{",".join(names[index] for index in group)}'


def subject(case: Examination, names: Sequence[str], group: Sequence[int]) -> str:
    """Return the names of sensors, with coordinates unless several have no others."""
    space = case.evidence.scenario.sensors[names[0]].sensor.output
    whole = len(names) > 1 and len(group) == space.size
    return ' and '.join(name if whole else label_of(case, name, group) for name in names)


def _inflation(case: Examination, name: str) -> float:
    """Return the ratio of squared innovations to their expectation, without outliers."""
    squares = case.passage.squares(name)
    size = case.evidence.scenario.sensors[name].sensor.output.size
    return max(1.0, float(np.median(squares)) / size) if len(squares) else 1.0


def _likeliest_factor(
    case: Examination, name: str, group: tuple[int, ...], factor: float, std: float
) -> tuple[float, float]:
    """Return the likeliest of the fitted factor, factors of units, the wrong sign, and a far one.

    If the errors of readings are large, so are those of the predictions to which the factor is
    fitted.
    """

    def gain(trial: float) -> float:
        return replaced(case, (name,), scaling(case, name, group, trial))[0]

    if abs(factor) < 1e-6:
        factor = 1e-6
    space = case.evidence.scenario.sensors[name].sensor.output
    stds = dict.fromkeys((-1.0, *conversions(space, group)), 0.0)
    excess = float(np.sum(case.passage.square - case.passage.sizes))
    if excess > _MISFIT * float(np.sum(case.passage.sizes)):
        far, far_std = _of_readings(case, name, group)
        if factor < 0.0 or abs(log(far / factor)) > _FAR:
            stds[far] = far_std
    best = max(stds, key=gain)
    likelier = gain(best) > max(gain(factor), _EXPLAINED * excess)
    return (best, stds[best]) if likelier else (factor, std)


def _of_readings(case: Examination, name: str, group: tuple[int, ...]) -> tuple[float, float]:
    """Return the factor of readings with the largest gain (see `replaced`), and its deviation.

    With the gradient g and the information M of the readings, 2 N log f + 2 (1 - f) g less
    (1 - f)^2 M has its maximum at a root of M f^2 + (g - M) f - N.
    """
    columns = [c for i in group for c in case.responses.columns('read', name, str(i), str(i))]
    g = float(case.responses.gradient[columns].sum())
    M = float(case.responses.information[np.ix_(columns, columns)].sum())
    N = len(case.passage.of(name)) * len(group)
    if not M > 0.0:
        return 1.0, 0.0
    root = ((M - g) ** 2 + 4.0 * M * N) ** 0.5
    factor = (M - g + root) / (2.0 * M) if g < M else 2.0 * N / (g - M + root)
    return factor, (M + N / factor**2) ** -0.5


def conversions(space: Space, group: tuple[int, ...]) -> dict[float, str]:
    """Return the factors of `UNITS` that apply to a group of coordinates, with their units."""
    group_units = {space.units[index] for index in group}
    texts: dict[float, str] = {}
    for factor, text, units in UNITS:
        if not units or group_units <= {'', *units}:
            texts[factor] = f'{texts[factor]} or {text}' if factor in texts else text
    return texts


def scaling(case: Examination, name: str, group: tuple[int, ...], factor: float) -> Array:
    """Return the matrix (k, k) that multiplies a group of coordinates by a factor."""
    M = np.eye(case.evidence.scenario.sensors[name].sensor.output.size)
    M[group, group] = factor
    return M


def replaced(case: Examination, names: Sequence[str], M: Array) -> tuple[float, float]:
    """Return the gain to first order if the readings y of some sensors become M y, and its dues.

    The density of y is the density of M y times |det M|, so that smaller readings alone are no
    gain. The dues are -2 log |det M| for each reading.
    """
    columns = [column for name in names for column in case.responses.columns('read', name)]
    size = np.tile((np.eye(len(M)) - M).ravel(), len(names))
    information = case.responses.information[np.ix_(columns, columns)]
    gain = float(2.0 * size @ case.responses.gradient[columns] - size @ information @ size)
    count = sum(len(case.passage.of(name)) for name in names)
    dues = -2.0 * count * float(np.linalg.slogdet(M)[1])
    return gain - dues, dues


def scaled(
    case: Examination,
    names: tuple[str, ...],
    group: tuple[int, ...],
    factor: float,
    std: float,
    gain: float,
    behind: bool = False,
) -> Finding:
    """Return the finding that coordinates of some sensors must be multiplied by a ``factor``.

    The noise arises before the wrong scale, and grows with it, or ``behind`` it.
    """
    evidence, name = case.evidence, names[0]
    space, index = evidence.scenario.sensors[name].sensor.output, group[0]
    label = subject(case, names, group)
    kind, factor, cause = classified(factor, std, conversions(space, group))
    M = scaling(case, name, group, factor)
    exact_gain, dues = replaced(case, names, M)
    record = evidence.sensors[name]
    times = record.stamp - evidence.start
    curves = (
        Curve('as read', times, record.value[:, index], 'dots'),
        Curve(f'times {factor:.4g}', times, factor * record.value[:, index], 'line'),
    )

    def again(after: Examination) -> Finding | None:
        fit = share(after, names, group)
        if fit is None or not fit.remains:
            return None
        nearer = factor * (1.0 - float(fit.size[0]))
        return scaled(case, names, group, nearer, abs(factor) * float(fit.std[0]), gain, behind)

    def mended() -> Evidence:
        return reduce(lambda before, name: mixed(before, name, M, behind), names, evidence)

    alone = len(names) == 1
    changes = [mixing(evidence, name, M, behind) for name in names]
    change = {key: value for part in changes for key, value in part.items()}
    shared = ' A parameter that they share, such as the radius of wheels, does the same.'
    return Finding(
        kind, label,
        f'readings of {label} fit the model once {"" if alone else "all are "}multiplied by '
        f'{factor:.4g}{cause}.{"" if alone or kind != "scale" else shared}',
        max(gain, 0.0)**0.5, change if all(changes) else {}, gain=max(gain, exact_gain), dues=dues,
        figure=Figure(f'{label}: scale', 'time [s]', space.names[index], curves), mended=mended,
        again=again if kind == 'scale' else None,
        instead=(lambda: scaled(case, names, group, factor, std, gain, True))
        if alone and kind == 'scale' and not behind else None,
    )  # fmt: skip


def classified(
    factor: float, std: float, conversions: Mapping[float, str]
) -> tuple[str, float, str]:
    """Return the kind of a factor, the exact factor of a near unit or sign, and the reason."""
    if factor < 0.0:
        if abs(factor + 1.0) < max(0.35, 4.0 * std):
            return 'sign', -1.0, ': they have the wrong sign'
        return 'sign', factor, f' ± {std:.1g}: they have the wrong sign, and another scale'
    near = min(conversions, key=lambda unit: abs(log(factor / unit)))
    close = max(_CLOSE, min(4.0 * std / factor, 0.25))
    doubt = min(_CLOSE, 2.0 * std / factor)
    plain = any(abs(log(factor / ratio)) < doubt for ratio in _PLAIN)
    if abs(log(factor / near)) < close and not plain:
        return 'unit', near, f': they are in {conversions[near]}'
    return 'scale', factor, f' ± {std:.1g}: their scale is wrong'


def mixed(evidence: Evidence, name: str, M: Array, behind: bool = False) -> Evidence:
    """Return the evidence with the readings y of a sensor, or y and its noise, replaced by M y."""
    record = evidence.sensors[name]
    if behind:
        record = replace(record, covariance=M @ record.covariance @ M.T)
    return evidence.with_sensor(name, replace(record, value=record.value @ M.T))


def mixing(evidence: Evidence, name: str, M: Array, behind: bool = False) -> dict[str, Any]:
    """Return the parameters of a linear sensor that reads M^-1 C x; empty if there are none.

    The noise is multiplied in the same way, so that it stays the same in the unit of the model,
    or arises ``behind`` C, and stays as it is.
    """
    scenario, parameters = evidence.scenario, section(evidence.parameters, name)
    sensor = scenario.sensors[name].sensor
    rest = np.zeros(scenario.model.state.size)
    if not sensor.linear or sensor.output.angles or abs(np.linalg.det(M)) < 1e-12:
        return {}
    if sensor.measure(rest).any():  # it reads another zero, which C x has not
        return {}
    inverse = np.linalg.inv(M)
    C = inverse @ sensor.jacobian(rest)
    way = np.eye(len(M)) if behind else inverse
    noise = np.sqrt(np.maximum((way @ sensor.covariance @ way.T).diagonal(), 0.0))
    known = {option.name for option in options(str(parameters.get('kind', 'states')))}
    removed = known.intersection(parameters) - {option.name for option in options('linear')}
    return {
        **{f'{name}.{key}': None for key in sorted(removed)},
        f'{name}.kind': 'linear',
        f'{name}.C': [float(f'{value:.6g}') for value in C.ravel()],
        f'{name}.names': list(sensor.output.names),
        f'{name}.noise': [float(f'{value:.4g}') for value in noise],
    }
