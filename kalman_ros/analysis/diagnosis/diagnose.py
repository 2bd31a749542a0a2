# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of a recording by forward selection of faults.

The first findings are those that stamps and values show without a filter. Each further finding is
the hypothesis with the largest gain: the reduction of -2 log likelihood by its correction, after a
new pass of the filter, less log N for each number that it fits (G. Schwarz, Estimating the
Dimension of a Model, Annals of Statistics 6(2), 1978). All kinds of faults are counted alike; a
random walk is a single number, its intensity, integrated over its path. The fault is corrected,
and the search is repeated until the remaining misfit is chance. Thus a delay is found before the
noise that would hide it, and the consequences of a fault vanish once the fault is corrected.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord

from . import (
    backlash,
    bias,
    coloured,
    common_noise,
    common_scale,
    contradicted_parameters,
    exchanged,
    first_belief,
    frozen,
    gates,
    generous,
    gravity,
    gross,
    input_axes,
    inputs,
    lag,
    lateness,
    leftover,
    lever_arms,
    message_covariances,
    mounting,
    noise_levels,
    norms,
    outliers,
    partly_read,
    quantisation,
    rate,
    saturation,
    stamps,
    stretch,
    uneven_stamps,
    units,
    unobserved_states,
    unrelated,
)
from .evidence import Evidence, improvement, misfit
from .examination import CHANCE, Examination
from .finding import Finding
from .passage import explained
from .trials import TIED, Trials, calibrated, same

Detector = Callable[[Examination], Iterable[Finding]]

#: Detectors of findings that need no filter; the first one replays the recording.
PLAIN: Sequence[Detector] = (
    gravity.find, stamps.find, message_covariances.find, lateness.find, rate.find,
    saturation.find, frozen.find, norms.find, quantisation.find,
)  # fmt: skip
#: Detectors of findings in the innovations of a filter.
FITTED: Sequence[Detector] = (
    units.find, common_scale.find, mounting.find, partly_read.find, exchanged.find,
    unrelated.find, outliers.find, lateness.hidden, lag.find, backlash.find, coloured.find,
    common_noise.find, bias.find, inputs.find, input_axes.find,
    contradicted_parameters.find, first_belief.find, noise_levels.find, lever_arms.find,
    stretch.find, uneven_stamps.find,
)  # fmt: skip
#: Detectors of findings that hold from the first seconds on.
SIMPLE: Sequence[Detector] = (
    units.find, common_scale.find, mounting.find, partly_read.find, bias.find, inputs.find,
    contradicted_parameters.find,
)  # fmt: skip
#: Detectors of findings of a constant size.
CONSTANT: Sequence[Detector] = (
    units.find, common_scale.find, mounting.find, partly_read.find, inputs.find,
    contradicted_parameters.find, lever_arms.find,
)  # fmt: skip
#: Largest numbers of rounds, of findings that are tried in a round, and of those of one kind.
_ROUNDS, _TRIED, _ALIKE = 6, 10, 3
#: Number of causes of the first seconds of a lost filter that are tried.
_EARLY = 3
#: Of how many causes beside the best one the size is fitted again.
_NEAREST = 3
#: A finding is tried if its predicted gain is at least this share of the best gain. The second
#: share applies to reliable predictions: the filter is not lost, and the gain is above `_SURE`.
_CLOSE, _CLOSER, _SURE = 0.4, 0.5, 1000.0
#: The share for a delay of the sensor of the best finding, the size of which is fitted again.
_BESIDE, _DELAYS = 0.2, ('stamps late', 'stamps early')
#: Causes that add something to readings.
_OFFSETS = ('bias', 'drift', 'random walk')
#: A change is proven by a replay of the first seconds if it explains this share of the misfit. A
#: smaller effect is hidden by the other faults, which the replay does not correct.
#: The replay is longer where the sensors of the change move later, by at most _LATEST s: where a
#: reading differs from the first one by _MOVED standard deviations.
PROOF, _PROVEN, _LATEST, _MOVED = 20.0, 0.01, 100.0, 5.0
#: A share of the misfit below this is little.
_LITTLE = 0.05
#: A cause with a smaller share of the explanation is a note; a first one whose replay fits worse
#: is no more certain than the second number.
_DOUBTFUL, _REFUTED = 0.01, 0.3


@dataclass(frozen=True)
class Diagnosis:
    """The ranked findings, notes that are no faults, and the misfit before and after."""

    findings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    before: float
    after: float


def diagnose(
    evidence: Evidence, progress: Callable[[str], None] = lambda text: None, *, proofs: bool = True
) -> Diagnosis:
    """Return the faults of a recording and of its parameters.

    Parameters
    ----------
    evidence
        Recording, and the results of the estimator.
    progress
        Receives the current activity, and what was found so far.
    proofs
        Whether each change is proven by a replay.
    """
    if np.isinf(evidence.scenario.initial_belief.covariance).any():
        raise ValueError('initial_std: expected finite ones for a diagnosis, got an infinite one')
    before = misfit(evidence)
    progress('stamps, rates and values')
    plain, case = _find_without_filter(evidence)
    findings = [finding for finding in plain if not finding.note]
    remarks = tuple(finding for finding in plain if finding.note)
    if not case.passage.events:
        return Diagnosis(_rank(findings), remarks, before, before)
    notes = [*remarks, *unobserved_states.find(case)]
    uncorrected: Examination | None = None
    if any(source.bias is not None for source in evidence.scenario.enabled.values()):
        uncorrected, case = case, Examination(bias.without_declared(case))
    findings += gates.find(case)
    first = len(findings)
    declared = case.evidence
    for number in range(_ROUNDS):
        progress(f'causes of the misfit, {number + 1}{_so_far(findings, first)}')
        best = _find_best(case, findings, uncorrected)
        if number == 0:
            best = _find_hidden(case, best)
        if best is None:
            break
        uncorrected = None
        finding, after = best
        case = case if finding.absorbs else after
        findings.append(finding)
    findings[first:] = noise_levels.restated(declared, findings[first:])
    notes += leftover.find(case)
    findings = noise_levels.withheld(case.evidence, findings, notes)
    sure, doubtful = divided(_rank(findings, slice(first, None)))
    if proofs:
        progress(f'proofs{_so_far(findings, first)}')
        sure = _doubted(tuple(_prove(evidence, finding) for finding in sure))
    return Diagnosis(sure, (*notes, *doubtful), before, case.passage.misfit)


def _so_far(findings: Sequence[Finding], first: int) -> str:
    """Return the first finding of those so far, in words; those from ``first`` on are in turn."""
    if not findings:
        return ''
    best = _rank(findings, slice(first, None))[0]
    return f'; so far: {best.kind} of {best.subject}'


def divided(findings: Sequence[Finding]) -> tuple[tuple[Finding, ...], list[Finding]]:
    """Return findings, the first one with a calibrated certainty, and as notes the doubtful."""
    doubtful = [_as_note(finding) for finding in findings if finding.certainty < _DOUBTFUL]
    sure = [finding for finding in findings if finding.certainty >= _DOUBTFUL]
    for first in sure[:1]:
        sure[0] = replace(first, certainty=min(calibrated(first.certainty), first.most))
    return tuple(sure), doubtful


def _as_note(finding: Finding) -> Finding:
    """Return a finding of next to no certainty as a note: no model is exact."""
    doubt = f'less than {100.0 * _DOUBTFUL:.0f} % sure is this: {finding.sentence}'
    return replace(finding, note=True, sentence=doubt)


def _find_without_filter(evidence: Evidence) -> tuple[list[Finding], Examination]:
    """Return the findings that need no filter, and the case with all of them corrected."""
    findings: list[Finding] = []
    case = Examination(evidence, strict=False)
    for detector in PLAIN:
        while finding := next((f for f in detector(case) if _is_new(f, findings)), None):
            if finding.mended is not None:
                after = Examination(finding.mended(), strict=False, known=finding.passage)
                if finding.passage is None:  # otherwise the pass does not change
                    gain = max(0.0, explained(case.passage, after.passage))
                    finding = replace(finding, gain=gain)
                case = after
            findings.append(finding)
    return findings, case


def _is_new(finding: Finding, known: Sequence[Finding]) -> bool:
    return not any(same(finding, other) for other in known)


def _find_best(
    case: Examination, known: Sequence[Finding], before: Examination | None = None
) -> tuple[Finding, Examination] | None:
    """Return the finding that explains most, with its actual gain, and the corrected case.

    ``before`` is the case with the biases that the estimator follows, where it has any.
    """
    trials = Trials(case)
    promised = _promised(case, FITTED, trials.dimension)
    sure = bool(promised) and promised[0].gain > _SURE and not gross.lost(case)
    share = _CLOSER if sure else _CLOSE
    # findings of filter passes come first: for a lost filter, regressions predict arbitrary gains
    from_passes = [*gross.find(case), *_from_the_beginning(case)]
    sentences = {finding.sentence for finding in from_passes}
    others = [f for f in promised if _is_new(f, known) and f.sentence not in sentences]
    for finding in [*from_passes, *_limit_kinds(others)][:_TRIED]:
        if finding.gain <= trials.threshold or not _is_new(finding, known):
            continue
        best = trials.best
        if best and finding not in from_passes and finding.gain < share * best.gain:
            break
        with suppress(np.linalg.LinAlgError):
            _try(finding.exact() if finding.exact else finding, trials)
    if before is not None:
        _try_before(before, trials)
    if best := trials.best:
        trials.add_nearer(best, trials.after)
        _try_beside(best, others, trials)
        # a walk has the shape of any slow cause, whose size may still be wrong
        near = 0.0 if best.most < 1.0 else TIED * best.gain
        tried = trials.tried.values()
        rivals = [f for f in tried if f.again and f.gain > near and not same(f, best)]
        for finding in sorted(rivals, key=_gain, reverse=True)[:_NEAREST]:
            assert finding.mended is not None
            trials.add_nearer(finding, Examination(finding.mended()))
    return trials.result()


def _find_hidden(
    case: Examination, best: tuple[Finding, Examination] | None
) -> tuple[Finding, Examination] | None:
    """Return the cause that generous noise hides, or the best one so far if there is none."""
    tried = [] if best is None or best[0].mended is None else [best[0]]
    hidden = generous.find(case, tried)
    if hidden is None or hidden.mended is None or (best is not None and same(hidden, best[0])):
        return best
    return hidden, Examination(hidden.mended())


def _try(finding: Finding, trials: Trials) -> None:
    """Try a finding by a pass over the corrected recording, which is large."""
    mended = finding.mended and Examination(finding.mended(), known=finding.passage)
    trials.add(finding, mended or trials.case)


def _try_beside(best: Finding, promised: Sequence[Finding], trials: Trials) -> None:
    """Try causes of the same sensor of which the trials so far are not the whole truth.

    A linearisation promises too little of a long delay. And an offset leaves the noise as it is,
    with which only a scale that does so, too, compares.
    """
    sensor = best.subject.partition('.')[0]
    for finding in promised:
        if finding.subject.partition('.')[0] == sensor and finding.gain > _BESIDE * best.gain:
            other = _beside(best, finding, trials)
            if other is not None and other.mended is not None:
                with suppress(np.linalg.LinAlgError):
                    trials.add_nearer(other, Examination(other.mended()))


def _beside(best: Finding, finding: Finding, trials: Trials) -> Finding | None:
    """Return the form of a finding that competes with the best one; None if it has none."""
    if finding.instead is not None and best.kind in _OFFSETS:
        return finding.instead()
    untried = (finding.kind, finding.subject) not in trials.tried
    return finding if finding.kind in _DELAYS and untried else None


def _promised(case: Examination, detectors: Sequence[Detector], dimension: float) -> list[Finding]:
    """Return the findings of detectors with what each promises, the most promising first."""
    findings = (finding for detector in detectors for finding in _found(detector, case))
    promised = (replace(f, gain=f.gain - dimension * f.parameters) for f in findings)
    return sorted(promised, key=_gain, reverse=True)


def _found(detector: Detector, case: Examination) -> list[Finding]:
    """Return what a detector finds; none without an inverse takes the others with it."""
    try:
        return list(detector(case))
    except np.linalg.LinAlgError:
        return []


def _try_before(before: Examination, trials: Trials) -> None:
    """Try the causes of a constant size beside the declared biases, before these are removed.

    The biases that the estimator follows take up most of the effect of a scale or a mounting.
    """
    promised = _promised(bias.integrated(before), CONSTANT, trials.dimension)
    for finding in _limit_kinds(promised)[:_NEAREST]:
        if trials.best and finding.gain < _CLOSE * trials.best.gain:
            break
        nearest: Finding | None = finding
        while nearest and nearest.mended and nearest.gain > trials.threshold:
            try:
                after = Examination(nearest.mended())
                trials.add(nearest, Examination(bias.without_declared(after)))
                once_more = nearest is finding and nearest.again
                nearest = once_more(bias.integrated(after)) if once_more else None
            except (ValueError, np.linalg.LinAlgError):
                break


def _from_the_beginning(case: Examination) -> list[Finding]:
    """Return the causes that explain the first seconds, with gains as of the whole recording."""
    if not gross.lost(case):
        return []
    first = gross.beginning(case)
    ratio = len(case.passage.events) / len(first.passage.events)
    findings = (finding for detector in SIMPLE for finding in detector(first))
    scaled = (replace(finding, gain=ratio * finding.gain) for finding in findings)
    return sorted(scaled, key=_gain, reverse=True)[:_EARLY]


def _gain(finding: Finding) -> float:
    return finding.gain


def _limit_kinds(findings: Sequence[Finding]) -> list[Finding]:
    """Return the first findings of each kind, so that every kind is tried."""
    seen: Counter[str] = Counter()
    kept = []
    for finding in findings:
        seen[finding.kind] += 1
        if seen[finding.kind] <= _ALIKE:
            kept.append(finding)
    return kept


def _proof_seconds(evidence: Evidence, finding: Finding) -> float:
    """Return how much of a recording is replayed: `PROOF` after what a change concerns moves.

    Before, a robot at rest shows neither a scale nor a delay.
    """
    moves = {name: _moves(record) for name, record in evidence.sensors.items() if len(record)}
    named = {name.partition('.')[0] for name in finding.change}
    of_sensors = [time for name, time in moves.items() if name in named]
    begin = max(of_sensors) if of_sensors else min(moves.values(), default=evidence.start)
    return PROOF + min(begin - evidence.start, _LATEST)


def _moves(record: SensorRecord) -> float:
    """Return when a reading differs from the first one by more than noise, or is the first."""
    with np.errstate(invalid='ignore'):
        std = np.sqrt(record.covariance.diagonal(axis1=1, axis2=2))
        moved = (np.abs(record.value - record.value[0]) > _MOVED * std).any(axis=1)
    return float(record.received[int(np.argmax(moved))])


def _prove(evidence: Evidence, finding: Finding) -> Finding:
    """Return a finding with the improvement of a replay of the first seconds with its change."""
    if not finding.change or 0.0 < finding.share < _PROVEN:
        return finding
    try:
        after = evidence.rerun(finding.change, _proof_seconds(evidence, finding))
    except ValueError:
        return replace(finding, change={})
    return replace(finding, proof=improvement(evidence, after))


def _doubted(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Return findings of which the first is doubted if a replay with its change fits worse.

    Those behind it may need the change of the first one to fit better. Silent sensors count
    neither way.
    """
    silent = tuple(finding for finding in findings if finding.silent)
    judged = findings[len(silent) :]
    if not judged or not judged[0].proof < -CHANCE:
        return findings
    first, *others = judged
    sentence = (
        f'{first.sentence} But a replay of the first seconds with its lines fits worse, so '
        'that they are left out: it is another cause, or not the only one.'
    )
    certainty = min(first.certainty, _REFUTED)
    doubted = replace(first, sentence=sentence, change={}, certainty=certainty)
    return *silent, doubted, *others


def _rank(findings: Sequence[Finding], in_turn: slice = slice(0)) -> tuple[Finding, ...]:
    """Return findings with their shares: silent sensors, then plain physics, then by gain.

    What explains little comes after facts without a likelihood, such as losses; cautions are last.
    Of findings ``in_turn`` none comes before an earlier one, which was the best one when both were
    tried: gains grow where noise was reduced in between.
    """
    weights, least = [finding.gain for finding in findings], inf
    for index in range(len(findings))[in_turn]:
        if not findings[index].cautious:
            weights[index] = least = min(least, weights[index])
    total = sum(max(0.0, finding.gain) for finding in findings)
    shared = [
        replace(finding, share=max(0.0, finding.gain) / total if total > 0.0 else 0.0)
        for finding in findings
    ]

    def order(index: int) -> tuple[bool, bool, bool, bool, float]:
        finding = shared[index]
        little = 0.0 < finding.share < _LITTLE
        return not finding.silent, not finding.plain, finding.cautious, little, -weights[index]

    return tuple(shared[index] for index in sorted(range(len(shared)), key=order))
