# SPDX-License-Identifier: Apache-2.0
"""Sensor noise and process noise that is declared too small or too large."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import exp, inf
from typing import Any

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array
from kalman_ros.scenario.parameter_text import yaml_value

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, DensityLevel, Figure, Finding, NoiseLevel
from .parameters import parameters
from .quantisation import rounding
from .refilter import misfits

#: A variance is suspected if its score exceeds this number of standard deviations.
_SUSPECT = 5.0
#: Logarithms of trial factors of a variance, and their refinement.
_FACTORS = np.array([-6.0, -4.0, -2.5, -1.2, -0.5, 0.5, 1.2, 2.5, 4.0, 6.0, 9.0])
_FINER = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
#: A standard deviation that differs by less than this factor is no finding.
_RELEVANT = 1.2
#: Factors of which the largest is no more than this times the smallest are one factor.
_ALIKE = 1.1
#: Findings of errors that are alike from one reading to the next, and what follows.
_ALIKE_IN_TIME = ('coloured noise', 'random walk', 'drift', 'unexplained')
_KEEP = (
    'But its errors are alike in time, which this scatter of single readings does not show: a '
    'filter with this noise would be surer than it should be. Keep the declared one.'
)
_ROUNDED = 'But rounding alone has {}, though not where the readings rest. Keep the declared one.'
#: Largest number of variances that are tried in a round, those with the largest scores.
_TRIED = 4


def find(case: Examination) -> list[Finding]:
    """Return the variances of readings and of the process that the data contradict.

    A variance is suspected if the derivative of the likelihood by it is large. Its factor follows
    from the likelihood itself, for which the filter is run with each candidate. R. Mehra, On the
    Identification of Variances and Adaptive Kalman Filtering, IEEE Trans. Automatic Control 15(2),
    1970, shows which variances the innovations determine.
    """
    scores = case.scores
    suspects, ways = {}, {}
    for group in _groups(scores.labels):
        score = scores.gradient[list(group)].sum()
        information = scores.information[np.ix_(group, group)].sum()
        suspects[group] = abs(float(score)) / np.sqrt(max(float(information), 1e-12))
        ways[group] = _FACTORS[_FACTORS * score > 0.0]
    largest = sorted(suspects, key=lambda group: -suspects[group])[:_TRIED]
    largest = [group for group in largest if suspects[group] > _SUSPECT]
    findings = []
    trials = {group: ways[group] for group in largest}
    for group, log, gain, spread in _search_factors(case, trials) if trials else ():
        if gain > CHANCE and abs(log) > 2.0 * np.log(_RELEVANT):
            label = scores.labels[group[0]]
            factor = exp(0.5 * log)
            if len(label) == 2:
                indices = [int(scores.labels[i][1]) for i in group]
                findings.append(_sensor_finding(case, label[0], indices, factor, gain, spread))
            else:
                findings += _process_finding(case, label[0], factor, gain, spread)
    return findings


def _groups(labels: Sequence[tuple[str, ...]]) -> list[tuple[int, ...]]:
    """Return the groups of variances: each alone, and all coordinates of a sensor together."""
    groups: list[tuple[int, ...]] = [(i,) for i in range(len(labels))]
    for name in dict.fromkeys(label[0] for label in labels if len(label) == 2):
        whole = tuple(i for i, label in enumerate(labels) if label[0] == name and len(label) == 2)
        if len(whole) > 1:
            groups.append(whole)
    return groups


def _search_factors(
    case: Examination, suspects: dict[tuple[int, ...], Array]
) -> list[tuple[tuple[int, ...], float, float, float]]:
    """Return each suspect with the best logarithm of its factor, its gain, and its deviation.

    The first trials of each are the logarithms of the factors towards which the likelihood grows.
    """
    labels, p = case.scores.labels, len(case.scores.labels)

    def gains_of(logs: dict[tuple[int, ...], Array]) -> dict[tuple[int, ...], Array]:
        rows = [(group, log) for group, many in logs.items() for log in many.tolist()]
        candidates = np.zeros((len(rows) + 1, p))
        for row, (group, log) in enumerate(rows):
            candidates[row, list(group)] = log
        values = misfits(case.passage, labels, candidates, case.densities)
        gains = iter(values[-1] - values[:-1])
        return {group: np.array([next(gains) for _ in many]) for group, many in logs.items()}

    coarse = gains_of(suspects)
    fine = {group: suspects[group][np.argmax(gains)] + _FINER for group, gains in coarse.items()}
    results = []
    for group, gains in gains_of(fine).items():
        logs, best = fine[group], int(np.argmax(gains))
        curvature = np.polyfit(logs, gains, 2)[0]
        spread = float(1.0 / np.sqrt(max(-curvature, 1e-6)))
        if not _FACTORS[0] + _FINER[0] < logs[best] < _FACTORS[-1] + _FINER[-1]:
            spread = inf  # it may be beyond all that was tried
        results.append((group, float(logs[best]), float(gains[best]), spread))
    return results


def restated(evidence: Evidence, findings: Sequence[Finding]) -> list[Finding]:
    """Return findings in which noise that was changed in turn is compared with what was declared.

    All changes of the noise of a sensor become one finding, or two if some of its coordinates are
    declared too small and others too large, in the place of the first of them. Each has the gain
    of its coordinates, and what fits after all changes. All changes of a process noise become one,
    or none if they cancel.
    """
    changes: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.level is not None:
            changes.setdefault(finding.level.sensor, []).append(finding)
    merged = list[Finding]()
    for finding in _densities_joined(findings):
        level = finding.level
        if level is None or len(changes[level.sensor]) == 1:
            merged.append(finding)
        elif finding is changes[level.sensor][0]:
            merged += _joined(evidence, changes[level.sensor])
    return merged


def _densities_joined(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Yield findings with one for all changes of a process noise, in the place of the first."""
    changes: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.density is not None:
            changes.setdefault(finding.density.name, []).append(finding)
    for finding in findings:
        if finding.density is None or len(changes[finding.density.name]) == 1:
            yield finding
        elif finding is changes[finding.density.name][0]:
            yield from _net(changes[finding.density.name])


def _net(changes: Sequence[Finding]) -> Iterator[Finding]:
    """Yield the finding that changes of one process noise in turn come to, if it is relevant."""
    levels = [finding.density for finding in changes if finding.density is not None]
    factor = float(np.prod([level.factor for level in levels]))
    net = levels[-1]._replace(factor=factor, spread=max(level.spread for level in levels))
    if abs(np.log(factor)) > np.log(_RELEVANT):
        gain = sum(finding.gain for finding in changes)
        # what takes a part of it back says nothing of the cause
        sure = max(
            finding.certainty
            for finding, level in zip(changes, levels)
            if (level.factor > 1.0) == (factor > 1.0)
        )
        yield replace(
            max(changes, key=lambda finding: finding.gain), **_density_stated(net), density=net,
            gain=gain, z=gain**0.5, certainty=sure,
        )  # fmt: skip


def _joined(evidence: Evidence, changes: Sequence[Finding]) -> Iterator[Finding]:
    """Yield the findings that changes of the noise of one sensor in turn come to."""
    levels = [finding.level for finding in changes if finding.level is not None]
    last = levels[-1]._replace(spread=max(level.spread for level in levels))
    declared = _declared(evidence.sensors[last.sensor])
    gains = np.zeros(len(declared))
    for finding, level in zip(changes, levels):
        gains[level.indices] += finding.gain / len(level.indices)
    largest = max(changes, key=lambda finding: finding.gain)
    sure = max(finding.certainty for finding in changes)
    others = tuple(
        (kind, subject)
        for kind, subject in largest.same_as
        if not kind.startswith('noise too') or subject.partition('.')[0] != last.sensor
    )
    lines = {name: value for finding in changes for name, value in finding.change.items()}
    changed = np.bincount([i for level in levels for i in level.indices], minlength=len(gains)) > 0
    logs = np.where(changed, np.log(last.after / declared), 0.0)
    ways = (np.flatnonzero(way * logs > np.log(_RELEVANT)).tolist() for way in (1.0, -1.0))
    for indices in sorted(ways, key=lambda indices: -gains[indices].sum()):
        if not indices:
            continue
        level, gain = last._replace(indices=indices, before=declared), float(gains[indices].sum())
        yield replace(
            largest, **_stated(evidence, level), level=level, change=lines, gain=gain,
            z=gain**0.5, certainty=sure, same_as=others,
        )  # fmt: skip


def withheld(
    evidence: Evidence, findings: Sequence[Finding], notes: Sequence[Finding]
) -> list[Finding]:
    """Return findings, of which none proposes noise that is smaller than errors are.

    Errors that are alike in time scatter less from one reading to the next than they are, and
    rounded readings at rest do not scatter.
    """
    alike = {finding.subject for finding in (*findings, *notes) if finding.kind in _ALIKE_IN_TIME}
    sensors = {subject.partition('.')[0] for subject in alike}

    def kept(finding: Finding) -> Finding:
        level = finding.level
        if finding.kind != 'noise too large':
            return finding
        if finding.subject.partition('.')[0] in sensors:
            return replace(finding, change={}, sentence=f'{finding.sentence} {_KEEP}')
        if level is None:
            return finding
        least = rounding(evidence.sensors[level.sensor])
        if (level.after[level.indices] < least[level.indices]).any():
            listed = ', '.join(f'{std:.3g}' for std in least[level.indices])
            sentence = f'{finding.sentence} {_ROUNDED.format(listed)}'
            return replace(finding, change={}, sentence=sentence)
        return finding

    return [kept(finding) for finding in findings]


def _describe(factors: Sequence[float], spread: float) -> tuple[str, str]:
    """Return whether a noise is too small or too large, by factors on one side of 1, and which."""
    way = 'small' if factors[0] > 1.0 else 'large'
    sizes = [factor if way == 'small' else 1.0 / factor for factor in factors]
    size, most = min(sizes), max(sizes)
    if spread == inf:
        return way, f'by a factor of at least {size:.3g}'
    if most > _ALIKE * size:
        return way, f'by factors of {size:.3g} to {most:.3g}'
    low, high = size * exp(-min(spread, 3.0)), size * exp(min(spread, 3.0))
    return way, f'by a factor of {size:.3g} ({low:.3g} to {high:.3g}, 95 %)'


def _stated(evidence: Evidence, level: NoiseLevel) -> dict[str, Any]:
    """Return the kind, the subject and the sentence of a finding about a noise."""
    space = evidence.scenario.sensors[level.sensor].sensor.output
    fits = {index: level.after[index] for index in level.indices}
    way, size = _describe([std / level.before[i] for i, std in fits.items()], level.spread)
    single = f'.{space.names[level.indices[0]]}' if len(fits) == 1 else ''
    subject = f'{level.sensor}{single}'
    words = ', '.join(f'{space.label(space.names[i])} {std:.3g}' for i, std in fits.items())
    sentence = (
        f'the declared noise of {subject} is too {way} {size}: standard deviations that fit are '
        f'{words}.'
    )
    return {'kind': f'noise too {way}', 'subject': subject, 'sentence': sentence}


def _declared(record: SensorRecord) -> Array:
    """Return the standard deviations (k,) with which readings were fused."""
    return np.sqrt(np.median(record.covariance, axis=0).diagonal())


def _sensor_finding(
    case: Examination, name: str, indices: list[int], factor: float, gain: float, spread: float
) -> Finding:
    evidence, record = case.evidence, case.evidence.sensors[name]
    std = _declared(record)
    scale = np.ones(len(std))
    scale[indices] = factor
    level = NoiseLevel(name, indices, std, scale * std, spread)
    change: dict[str, Any] = {f'{name}.noise': [float(f'{value:.3g}') for value in scale * std]}
    configured = np.sqrt(evidence.scenario.sensors[name].sensor.covariance.diagonal())
    if not np.allclose(std, configured, rtol=1e-3):
        change[f'{name}.covariance_from'] = 'configuration'
    covariance = record.covariance * scale[:, None] * scale[None, :]
    return Finding(
        **_stated(evidence, level), z=gain**0.5, change=change, gain=gain, level=level,
        figure=innovations(case, name, indices[0]),
        mended=lambda: _with_covariance(evidence, name, covariance),
    )  # fmt: skip


def _with_covariance(evidence: Evidence, name: str, covariance: Array) -> Evidence:
    record = replace(evidence.sensors[name], covariance=covariance)
    return evidence.with_sensor(name, record)


def _process_finding(
    case: Examination, name: str, factor: float, gain: float, spread: float
) -> list[Finding]:
    known = {parameter.name: parameter for parameter in parameters(case.evidence)}
    density = known.get(name)
    change = density.change(density.value * factor**2) if density else {}
    try:
        mended = case.evidence.adopting(change) if change else case.evidence.noisier(factor**2)
    except (ValueError, TypeError):  # of a class whose objects have no other class
        return []
    level = DensityLevel(name, factor, spread, change)
    finding = Finding(
        **_density_stated(level), z=gain**0.5, gain=gain, mended=lambda: mended, density=level,
        figure=innovations(case, case.passage.names[0], 0),
    )  # fmt: skip
    return [finding]


def _density_stated(level: DensityLevel) -> dict[str, Any]:
    """Return the kind, the subject, the sentence and the change of a finding."""
    way, size = _describe([level.factor], level.spread)
    fits = 'no parameter of that name scales it: multiply what the model returns.'
    if level.change:
        fits = f'{yaml_value(next(iter(level.change.values())))} fits.'
    sentence = f'the process noise {level.name} is too {way}, its root {size}: {fits}'
    kind = f'process noise too {way}'
    return {
        'kind': kind, 'subject': level.name, 'sentence': sentence, 'change': level.change,
    }  # fmt: skip


def innovations(case: Examination, name: str, index: int) -> Figure:
    """Return the picture of the innovations of a coordinate with their bounds."""
    times = case.passage.series('time', name) - case.evidence.start
    values = case.passage.series('innovation', name)[:, index]
    bound = 2.0 * np.sqrt(case.passage.series('S', name)[:, index, index])
    label = case.evidence.scenario.sensors[name].sensor.output.names[index]
    curves = (
        Curve('innovation', times, values, 'dots'),
        Curve('2 sigma', times, bound, 'bound'),
        Curve('', times, -bound, 'bound'),
    )
    return Figure(f'{name}: innovations of {label}', 'time [s]', label, curves)
