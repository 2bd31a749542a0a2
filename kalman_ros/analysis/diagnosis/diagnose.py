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
from dataclasses import dataclass, replace
from math import exp, log

import numpy as np

from . import (
    bias,
    common_noise,
    contradicted_parameters,
    exchanged,
    first_belief,
    frozen,
    gates,
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
    outliers,
    quantisation,
    rate,
    saturation,
    stamps,
    stretch,
    units,
    unobserved_states,
    unrelated,
)
from .evidence import Evidence, improvement, misfit
from .examination import CHANCE, Examination
from .finding import Finding
from .passage import Passage, explained

Detector = Callable[[Examination], Iterable[Finding]]

#: Detectors of findings that need no filter.
PLAIN: Sequence[Detector] = (
    stamps.find, message_covariances.find, lateness.find, rate.find,
    saturation.find, frozen.find, quantisation.find,
)  # fmt: skip
#: Detectors of findings in the innovations of a filter.
FITTED: Sequence[Detector] = (
    units.find, mounting.find, exchanged.find, unrelated.find, outliers.find, lateness.hidden,
    lag.find, bias.find, inputs.find, input_axes.find, contradicted_parameters.find,
    first_belief.find, noise_levels.find, lever_arms.find, stretch.find,
)  # fmt: skip
#: Detectors of findings that hold from the first seconds on.
SIMPLE: Sequence[Detector] = (
    units.find, mounting.find, bias.find, inputs.find, contradicted_parameters.find,
)  # fmt: skip
#: Detectors of findings of a constant size.
CONSTANT: Sequence[Detector] = (
    units.find, mounting.find, inputs.find, contradicted_parameters.find, lever_arms.find,
)  # fmt: skip
#: Largest numbers of rounds, of findings that are tried in a round, and of those of one kind.
_ROUNDS, _TRIED, _ALIKE = 6, 10, 3
#: Number of causes of the first seconds of a lost filter that are tried.
_EARLY = 3
#: How often the size of a finding is fitted again, and of how many beside the best one.
_REFINED, _NEAREST = 3, 3
#: A finding is tried if its predicted gain is at least this share of the best gain. The second
#: share applies to reliable predictions: the filter is not lost, and the gain is above `_SURE`.
_CLOSE, _CLOSER, _SURE = 0.4, 0.5, 1000.0
#: A change is proven by a replay of the first seconds if it explains this share of the misfit. A
#: smaller effect is hidden by the other faults, which the replay does not correct.
PROOF, _PROVEN = 20.0, 0.01
#: By how much the likelihood is tempered, as a share of the gain.
_TEMPER = 0.15
#: The share of the best gain from which another cause fits as well.
_TIED = 0.85
#: A mean square of innovations this near to 1 is that of a filter that is right.
_CONSISTENT = 0.03
#: A share of the misfit below this is little.
_LITTLE = 0.05
#: A cause of a smaller certainty is a note.
_DOUBTFUL = 0.01
#: A gain below this share of the number of values read is irrelevant, even if it is significant.
_RELEVANT = 0.002


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
    for number in range(_ROUNDS):
        progress(f'causes of the misfit, {number + 1}{_so_far(findings)}')
        best = _find_best(case, findings, uncorrected)
        if best is None:
            break
        uncorrected = None
        finding, case = best
        findings.append(finding)
    findings += common_noise.find(case)
    notes += leftover.find(case)
    ranked = _rank(findings)
    if proofs:
        progress(f'proofs{_so_far(findings)}')
        ranked = tuple(_prove(evidence, finding) for finding in ranked)
    sure, doubtful = divided(ranked)
    return Diagnosis(tuple(sure), (*notes, *doubtful), before, case.passage.misfit)


def _so_far(findings: Sequence[Finding]) -> str:
    """Return the first finding of those so far, in words."""
    if not findings:
        return ''
    first = _rank(findings)[0]
    return f'; so far: {first.kind} of {first.subject}'


def divided(findings: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Return the findings, and as notes those of next to no certainty."""
    sure = [finding for finding in findings if finding.certainty >= _DOUBTFUL]
    return sure, [_as_note(finding) for finding in findings if finding.certainty < _DOUBTFUL]


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


def same(one: Finding, other: Finding) -> bool:
    """Return whether two findings have the same kind and subject."""
    return (one.kind, one.subject) == (other.kind, other.subject)


class _Trials:
    """Causes that were tried on a case, the best one, and the case corrected by it."""

    def __init__(self, case: Examination) -> None:
        count = sum(len(e) for e in case.passage.whitened)
        self.case, self.after = case, case
        #: The smallest gain of a cause, and the cost of each number that it fits.
        self.threshold, self.dimension = max(CHANCE, _RELEVANT * count), log(max(count, 2))
        #: The nearest finding of each cause, by kind and subject.
        self.tried: dict[tuple[str, str], Finding] = {}
        self.best: Finding | None = None

    def gain(self, finding: Finding, after: Examination) -> float:
        """Return the gain of a finding, with the case that is corrected by it."""
        change = explained(self.case.passage, after.passage) - finding.dues
        exact = finding.gain if finding.is_exact else change
        return exact - self.dimension * finding.parameters

    def add(self, finding: Finding, after: Examination) -> None:
        """Add a finding with its gain, if that is no chance."""
        gain = self.gain(finding, after)
        if gain <= self.threshold:
            return
        cause, finding = (finding.kind, finding.subject), replace(finding, gain=gain, passage=None)
        self.tried[cause] = max(finding, self.tried.get(cause, finding), key=_gain)
        if self.best is None or gain > self.best.gain:
            self.best, self.after = finding, after

    def add_nearer(self, finding: Finding, after: Examination) -> None:
        """Add a finding with a better size.

        The size is that of a linearisation. It is fitted again about the corrected case, as long
        as the gain grows (Newton's method).
        """
        finding = replace(finding, gain=self.gain(finding, after))
        for _ in range(_REFINED):
            better = finding.again and finding.again(after)
            if not better or better.mended is None:
                break
            try:
                nearer = Examination(better.mended())
                gain = self.gain(better, nearer)
            except (ValueError, np.linalg.LinAlgError):
                break
            if gain <= finding.gain:
                break
            finding, after = replace(better, gain=gain, same_as=finding.same_as), nearer
        self.add(finding, after)

    def result(self) -> tuple[Finding, Examination] | None:
        """Return the best finding with its certainty, and the corrected case; None without one."""
        if self.best is None:
            return None
        finding = self.best
        rivals = [rival for rival in self.tried.values() if not same(rival, finding)]
        share = certainty(finding.gain, [rival.gain for rival in rivals])
        whole = completeness(self.case.passage, self.after.passage)
        tied = [(f.kind, f.subject) for f in rivals if f.gain > _TIED * finding.gain]
        return replace(
            finding, certainty=min(share * whole, finding.most), same_as=(*finding.same_as, *tied)
        ), self.after


def _find_best(
    case: Examination, known: Sequence[Finding], before: Examination | None = None
) -> tuple[Finding, Examination] | None:
    """Return the finding that explains most, with its actual gain, and the corrected case.

    ``before`` is the case with the biases that the estimator follows, where it has any.
    """
    trials = _Trials(case)
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
        try:
            finding = finding.exact() if finding.exact else finding
            mended = finding.mended and Examination(finding.mended(), known=finding.passage)
            trials.add(finding, mended or case)
        except np.linalg.LinAlgError:
            continue
    if before is not None:
        _try_before(before, trials)
    if best := trials.best:
        trials.add_nearer(best, trials.after)
        # a walk has the shape of any slow cause, whose size may still be wrong
        near = 0.0 if best.most < 1.0 else _TIED * best.gain
        tried = trials.tried.values()
        rivals = [f for f in tried if f.again and f.gain > near and not same(f, best)]
        for finding in sorted(rivals, key=_gain, reverse=True)[:_NEAREST]:
            assert finding.mended is not None
            trials.add_nearer(finding, Examination(finding.mended()))
    return trials.result()


def _promised(case: Examination, detectors: Sequence[Detector], dimension: float) -> list[Finding]:
    """Return the findings of detectors with what each promises, the most promising first."""
    found = (finding for detector in detectors for finding in detector(case))
    promised = (replace(f, gain=f.gain - dimension * f.parameters) for f in found)
    return sorted(promised, key=_gain, reverse=True)


def _try_before(before: Examination, trials: _Trials) -> None:
    """Try the causes of a constant size beside the declared biases, before these are removed.

    The biases that the estimator follows take up most of the effect of a scale or a mounting.
    """
    promised = _promised(bias.integrated(before), CONSTANT, trials.dimension)
    for finding in _limit_kinds(promised)[:_NEAREST]:
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
    found = (finding for detector in SIMPLE for finding in detector(first))
    scaled = (replace(finding, gain=ratio * finding.gain) for finding in found)
    return sorted(scaled, key=_gain, reverse=True)[:_EARLY]


def certainty(gain: float, rivals: Iterable[float]) -> float:
    """Return the posterior share of a cause, and of those that fit as well, among its rivals.

    The gains of rivals are differences of the Bayesian information criterion, so that weights are
    exp(gain / 2) (R. Kass and A. Raftery, Bayes Factors, J. American Statistical Association 90,
    1995), of a likelihood that is tempered by `_TEMPER` of the gain: no model is exact, and its
    error grows with the misfit.
    """
    scale = 2.0 + _TEMPER * gain
    weights = [(other, exp(min(0.0, other - gain) / scale)) for other in rivals]
    tied = 1.0 + sum(weight for other, weight in weights if other > _TIED * gain)
    return tied / (1.0 + sum(weight for _, weight in weights))


def completeness(before: Passage, after: Passage) -> float:
    """Return the share of the misfit that a correction explains, from 0 to 1, squared.

    The mean square of whitened innovations is 1 if the filter is right. What the correction
    changes is compared with how far it remains from 1, since a cause that leaves much unexplained
    is seldom the right one. The square of the share agrees with how often first findings are
    right on recordings of other origin.
    """
    start, end = before.mean_square, after.mean_square
    change, left = abs(start - end), max(abs(end - 1.0) - _CONSISTENT, 0.0)
    return (change / (change + left)) ** 2 if change + left > 0.0 else 1.0


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


def _prove(evidence: Evidence, finding: Finding) -> Finding:
    """Return a finding with the improvement of a replay of the first seconds with its change."""
    if not finding.change or 0.0 < finding.share < _PROVEN:
        return finding
    try:
        after = evidence.rerun(finding.change, PROOF)
    except ValueError:
        return replace(finding, change={})
    return replace(finding, proof=improvement(evidence, after))


def _rank(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings with their shares: silent sensors first, then by gain.

    What explains little comes after facts without a likelihood, such as losses; cautions are last.
    """
    total = sum(max(0.0, finding.gain) for finding in findings)
    shared = [
        replace(finding, share=max(0.0, finding.gain) / total if total > 0.0 else 0.0)
        for finding in findings
    ]

    def order(finding: Finding) -> tuple[bool, bool, bool, float]:
        little = 0.0 < finding.share < _LITTLE
        return not finding.silent, finding.cautious, little, -finding.gain

    return tuple(sorted(shared, key=order))
