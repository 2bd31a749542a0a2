# SPDX-License-Identifier: Apache-2.0
"""Offsets of readings: constant, stepwise, growing, or wandering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from kalman_ros.core import Array

from . import wandering
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import edges, offset_responses
from .passage import explained
from .responses import Fit, Responses

#: The gain that each further fitted number must have, about log N of a recording.
_COST = 10.0
#: Kinds of courses, from the simplest on.
_KINDS = ('constant', 'ramp', 'step', 'walk')
#: Kind of the finding of a course; of any other it is a bias.
_NAMES = {'ramp': 'drift', 'walk': 'random walk'}
#: A simpler course is preferred if its gain is smaller by no more than chance and the first share.
#: A simpler course is tried in addition to a walk if its gain is smaller by no more than the
#: second share, since predicted gains hold for a linearisation only.
_AS_MUCH, _NEARLY = 0.005, 0.1
#: Number of standard deviations up to which an offset is as declared.
_DECLARED = 4.0
#: Most readings of a pass for which the likelihood of a walk is exact: it takes some seconds.
_LONGEST = 20_000
#: Largest certainty of a walk, which has the shape of any slow cause without a name here.
SUREST = 0.8
#: A walk is about constant if its mean is this many times its standard deviation.
_STEADY = 3.0
#: Into how many parts the pieces beside a step are divided.
_FINER = 8
#: Trial intensities of random walks, relative to the variance that the data allow.
_INTENSITIES = np.geomspace(1e-4, 1e4, 33)


@dataclass(frozen=True)
class Course:
    """The course of an offset over the B pieces of a recording, and its gain.

    ``kind`` is 'constant', 'step', 'ramp' or 'walk', ``values`` (B,) has an offset for each piece,
    and ``began`` is the piece in which a step begins. ``dues`` is by how much the gain of a
    correction by these values exceeds that of the kind: a path is chosen among many. ``density``
    is that of a walk, in each piece.
    """

    kind: str
    values: Array
    gain: float
    fit: Fit | None = None
    began: int = 0
    dues: float = 0.0
    density: float = 0.0


def find(case: Examination) -> list[Finding]:
    """Return the offsets of each sensor: a bias, a drift or a random walk of its coordinates."""
    findings = []
    limits = edges(case.passage)
    for name in case.judged:
        size = case.evidence.scenario.sensors[name].sensor.output.size
        groups = {i: case.responses.columns('offset', name, str(i)) for i in range(size)}
        about = case.evidence.scenario.sensors[name].bias is not None
        courses = courses_of(case.responses, groups, about=about)
        if not courses:
            continue
        findings.append(_finding(case, name, *_in_time(case, name, courses, limits)))
        simpler = courses_of(case.responses, groups, kinds=_KINDS[:-1], about=about)
        similar = _total_gain(simpler) > (1.0 - _NEARLY) * _total_gain(courses)
        if similar and _kind_of(courses) == 'walk':
            findings.append(_finding(case, name, *_in_time(case, name, simpler, limits)))
        if _kind_of(courses) == 'ramp':
            steps = courses_of(case.responses, groups, kinds=('step',), about=about)
            if _total_gain(steps) > _total_gain(courses):
                findings.append(_finding(case, name, *_in_time(case, name, steps, limits)))
    return findings


def _in_time(
    case: Examination, name: str, courses: dict[int, Course], limits: Array
) -> tuple[dict[int, Course], Array]:
    """Return the courses, with steps that begin when they do, and the limits of their pieces."""
    steps = [course for course in courses.values() if course.kind == 'step']
    if not steps:
        return courses, limits
    began = max(steps, key=lambda course: course.gain).began
    around = np.linspace(limits[began - 1], limits[began + 1], 2 * _FINER + 1)
    finer = np.unique(np.concatenate((limits, around)))
    responses = offset_responses(case.passage, name, finer)
    groups = {index: responses.columns('offset', name, str(index)) for index in courses}
    about = case.evidence.scenario.sensors[name].bias is not None
    exact = courses_of(responses, groups, kinds=('step',), about=about)
    return (exact, finer) if exact else (courses, limits)


def without_declared(case: Examination) -> Evidence:
    """Return the evidence without the biases that the estimator follows: the likeliest ones.

    Of offsets b of the pieces with the prior covariance S, of a random walk, these are
    (M + S^-1)^-1 g, where g and M are gradient and information. A bias that is larger than it is
    declared to be remains.
    """
    evidence, limits = case.evidence, edges(case.passage)
    priors, columns = _declared(case)
    if not priors:
        return evidence
    offsets = _inverse(case, priors, columns) @ case.responses.gradient[columns]
    for (name, index, covariance), path in zip(priors, offsets.reshape(len(priors), -1)):
        if np.abs(path).max() <= _DECLARED * covariance.diagonal().max() ** 0.5:
            evidence = _shifted(evidence, name, index, path, limits)
    return evidence


def integrated(case: Examination) -> Examination:
    """Return the case with responses from which the declared biases are integrated out.

    The rest of the innovations is what no such bias explains: with the offsets b as above, g and M
    become g - M_b (M_bb + S^-1)^-1 g_b and M - M_b (M_bb + S^-1)^-1 M_b'.
    """
    priors, columns = _declared(case)
    if not priors:
        return case
    g, M = case.responses.gradient, case.responses.information
    share = M[:, columns] @ _inverse(case, priors, columns)
    left = Responses(case.responses.labels, g - share @ g[columns], M - share @ M[columns])
    return Examination(case.evidence, case.strict, case.passage, left)


def _declared(case: Examination) -> tuple[list[tuple[str, int, Array]], list[int]]:
    """Return the prior covariance of each declared bias in pieces, and the columns of all."""
    limits = edges(case.passage)
    middles = 0.5 * (limits[1:] + limits[:-1]) - limits[0]
    priors: list[tuple[str, int, Array]] = []
    columns: list[int] = []
    for name in case.judged:
        bias = case.evidence.scenario.sensors[name].bias
        for index in range(0 if bias is None else len(bias.covariance)):
            assert bias is not None
            walk = bias.density[index, index] * np.minimum.outer(middles, middles)
            priors.append((name, index, bias.covariance[index, index] + walk))
            columns += case.responses.columns('offset', name, str(index))
    return priors, columns


def _inverse(
    case: Examination, priors: Sequence[tuple[str, int, Array]], columns: Sequence[int]
) -> Array:
    """Return (M + S^-1)^-1 of offsets with the information M and the prior covariance S."""
    prior = block_diag(*(covariance for _, _, covariance in priors))
    information = case.responses.information[np.ix_(columns, columns)]
    return np.asarray(prior @ np.linalg.inv(np.eye(len(prior)) + information @ prior))


def _shifted(evidence: Evidence, name: str, index: int, path: Array, limits: Array) -> Evidence:
    """Return the evidence without an offset of a coordinate in each piece."""
    record = evidence.sensors[name]
    pieces = np.clip(np.searchsorted(limits, record.stamp, 'right') - 1, 0, len(path) - 1)
    return evidence.with_column(name, index, record.value[:, index] - path[pieces])


def _kind_of(courses: Mapping[int, Course]) -> str:
    return next(iter(courses.values())).kind


def _total_gain(courses: Mapping[int, Course]) -> float:
    return sum(course.gain for course in courses.values())


def courses_of(
    responses: Responses,
    groups: Mapping[int, Sequence[int]],
    cost: float = _COST,
    kinds: Sequence[str] = _KINDS,
    *,
    about: bool = False,
) -> dict[int, Course]:
    """Return the significant courses of several coordinates, by index.

    All courses are of one kind, the simplest that explains as much as any other. A walk is a
    random effect with the covariance min(t, s) times an intensity, whose likelihood accounts for
    its degrees of freedom (N. Laird and J. Ware, Random-Effects Models for Longitudinal Data,
    Biometrics 38(4), 1982). The other kinds have a single parameter, but a step may be ``about``
    a bias that the estimator follows, and which was removed with a part of the step.
    """
    candidates = []
    for kind in kinds:
        courses = {
            index: _best_course(responses, columns, kind, cost, about)
            for index, columns in groups.items()
            if columns
        }
        courses = {i: course for i, course in courses.items() if course.gain > CHANCE}
        candidates.append((_total_gain(courses), courses))
    highest = max(total for total, _ in candidates)
    least = (1.0 - _AS_MUCH) * highest - CHANCE
    return next(courses for total, courses in candidates if total >= least)


def _best_course(
    responses: Responses, columns: Sequence[int], kind: str, cost: float, about: bool = False
) -> Course:
    """Return the best course of a kind over the pieces of one coordinate."""
    if kind == 'walk':
        walk = _likeliest_walk(responses, columns)
        return replace(walk, gain=walk.gain - cost)
    B = len(columns)
    penalty = cost + 2.0 * np.log(max(B, 2)) * (_numbers_of(kind) - 1)
    best = Course(kind, np.zeros(B), -np.inf)
    for began in range(1, B) if kind == 'step' else (0,):
        shapes = [np.ones(B)] if about and kind == 'step' else []
        basis = np.column_stack([*shapes, _shape(kind, began, B)])
        fit = responses.fit(basis, columns)
        if fit.gain - penalty > best.gain:
            last = Fit(fit.size[-1:], fit.covariance[-1:, -1:], fit.gain)
            best = Course(kind, basis @ fit.size, fit.gain - penalty, last, began)
    return best


def _shape(kind: str, began: int, pieces: int) -> Array:
    """Return a course of unit size over the pieces (B,)."""
    if kind == 'ramp':
        return np.asarray(np.arange(pieces) + 0.5)
    return np.asarray(np.arange(pieces) >= began, dtype=float)


def _likeliest_walk(responses: Responses, columns: Sequence[int]) -> Course:
    """Return the likeliest random walk over the pieces of one coordinate."""
    g = responses.gradient[list(columns)]
    M = responses.information[np.ix_(columns, columns)]
    t = np.arange(len(columns)) + 1.0
    root = np.linalg.cholesky(np.minimum.outer(t, t))
    values, vectors = np.linalg.eigh(root.T @ M @ root)
    values = np.maximum(values, 0.0)
    projected = vectors.T @ root.T @ g
    scale = 1.0 / max(float(values.mean()), 1e-300)
    gains = [
        float(np.sum(q * projected**2 / (1.0 + q * values) - np.log1p(q * values)))
        for q in scale * _INTENSITIES
    ]
    best = int(np.argmax(gains))
    q = float(scale * _INTENSITIES[best])
    path = root @ (vectors @ (q * projected / (1.0 + q * values)))
    corrected = float(2.0 * path @ g - path @ M @ path)
    dues = max(corrected - gains[best], 0.0)
    return Course('walk', path, gains[best], dues=dues, density=q)


def _finding(case: Examination, name: str, courses: dict[int, Course], limits: Array) -> Finding:
    evidence = case.evidence
    space = evidence.scenario.sensors[name].sensor.output
    main = max(courses.values(), key=lambda course: course.gain)
    kind = _NAMES.get(main.kind, 'bias')
    words = ', '.join(
        f'{space.label(space.names[index])} {_describe(course, limits)}'
        for index, course in courses.items()
    )
    middles = 0.5 * (limits[1:] + limits[:-1]) - limits[0]
    curves = tuple(
        Curve(space.label(space.names[index]), middles, course.values)
        for index, course in courses.items()
    )
    gain = sum(course.gain for course in courses.values())

    def mended() -> Evidence:
        corrected = evidence
        for index, course in courses.items():
            corrected = _shifted(corrected, name, index, course.values, limits)
        return corrected

    def again(after: Examination) -> Finding | None:
        """Return the offsets with what remains of them; None for walks."""
        if main.kind == 'walk':
            return None
        nearer, responses = {}, offset_responses(after.passage, name, limits)
        for index, course in courses.items():
            columns = responses.columns('offset', name, str(index))
            shape = _shape(course.kind, course.began, len(columns))
            more = responses.fit(shape[:, None], columns)
            values = course.values + shape * float(more.size[0])
            nearer[index] = replace(course, values=values, fit=more)
        return _finding(case, name, nearer, limits)

    def exact() -> Finding:
        """Return the walk with its likelihood, and without it a path that is drawn."""
        indices, length = list(courses), float(limits[1] - limits[0])
        densities = np.array([course.density for course in courses.values()]) / length
        record, coarse = evidence.sensors[name], replace(finding, exact=None)
        if len(case.passage.events) > _LONGEST:
            return coarse
        try:
            gain, path = wandering.likeliest(case.passage, name, indices, densities)
        except np.linalg.LinAlgError:
            return coarse
        constant = _constant(case, name, courses, path, limits)
        if constant is not None and constant.gain > (1.0 - _AS_MUCH) * gain - CHANCE:
            return constant
        times, index, nu = (
            case.passage.series(field, name) for field in ('time', 'index', 'innovation')
        )
        predicted = record.value[index] - nu
        if not wandering.is_walk(times, path, predicted):
            return coarse
        value = record.value.copy()
        for column, index in enumerate(indices):
            value[:, index] -= np.interp(record.stamp, times, path[:, column])
        without = evidence.with_values(name, value)
        return replace(
            finding, gain=gain, is_exact=True, exact=None, mended=lambda: without, again=None
        )

    walks = main.kind == 'walk' and all(course.kind == 'walk' for course in courses.values())
    finding = Finding(
        kind, name,
        f'readings of {name} are off: {words}. Calibrate it, or let the estimator follow it '
        '(bias_std).',
        gain**0.5, gain=gain, dues=sum(course.dues for course in courses.values()),
        parameters=sum(_numbers_of(course.kind) for course in courses.values()),
        figure=Figure(f'{name}: its offset', 'time [s]', 'offset', curves), mended=mended,
        again=again, exact=exact if walks else None, most=SUREST if walks else 1.0,
    )  # fmt: skip
    return finding


def _constant(
    case: Examination, name: str, courses: Mapping[int, Course], path: Array, limits: Array
) -> Finding | None:
    """Return the bias about which a walk wanders by little, with its gain; None without one.

    A filter that the bias misleads may be too far off for a regression to find it.
    """
    mean, spread = path.mean(axis=0), path.std(axis=0)
    about = {
        index: Course('constant', np.full(len(course.values), size), course.gain)
        for (index, course), size, std in zip(courses.items(), mean.tolist(), spread.tolist())
        if abs(size) > _STEADY * std
    }
    if not about:
        return None
    finding = _finding(case, name, about, limits)
    assert finding.mended is not None
    try:
        gain = explained(case.passage, Examination(finding.mended()).passage)
    except np.linalg.LinAlgError:
        return None
    return replace(finding, gain=gain, z=max(gain, 0.0) ** 0.5)


def _numbers_of(kind: str) -> int:
    """Return how many numbers are fitted: a size, and when a step begins."""
    return 2 if kind == 'step' else 1


def _describe(course: Course, limits: Array) -> str:
    if course.kind == 'walk':
        return f'wanders between {course.values.min():+.3g} and {course.values.max():+.3g}'
    if course.kind == 'ramp':
        rate = course.values[-1] / (limits[-1] - limits[0])
        return f'drifts by {rate:+.3g} a second'
    std = float(course.fit.std[0]) if course.fit else 0.0
    since = f' from t = {limits[course.began] - limits[0]:.3g} s on' if course.began else ''
    size = course.values[-1] - (course.values[0] if course.began else 0.0)
    return f'by {size:+.4g} ± {std:.1g}{since}'
