# SPDX-License-Identifier: Apache-2.0
"""The diagnosis: what explains most is found first, corrected, and the rest is looked at again.

First what stamps and values show without a filter, then a forward selection by likelihood: of all
hypotheses the one whose correction reduces -2 log likelihood most, the simpler one where two
explain nearly the same, until what is left is chance. So a delay is found before the noise that
would hide it, and what only follows from a fault is gone once the fault is corrected.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import (
    bias,
    contradicted_parameters,
    first_belief,
    frozen,
    gates,
    gross,
    inputs,
    lateness,
    message_covariances,
    mounting,
    noise_levels,
    outliers,
    quantisation,
    rate,
    stamps,
    units,
    unobserved_states,
    unrelated,
)
from .evidence import Evidence, improvement, misfit
from .examination import CHANCE, Examination
from .finding import Finding
from .passage import explained

Detector = Callable[[Examination], Iterable[Finding]]

#: What shows without a filter.
PLAIN: Sequence[Detector] = (
    stamps.find, message_covariances.find, lateness.find, rate.find, frozen.find,
    quantisation.find,
)  # fmt: skip
#: What a filter's innovations show.
FITTED: Sequence[Detector] = (
    units.find, mounting.find, unrelated.find, outliers.find, lateness.hidden, bias.find,
    inputs.find, contradicted_parameters.find, first_belief.find, noise_levels.find,
)  # fmt: skip
#: How much simpler a cause is than others that explain as much: its gain is multiplied by this,
#: or increased by the `_MOST_FAVOUR` where that is less.
SIMPLER = {
    'unit': 1.1, 'sign': 1.1, 'swapped': 1.1, 'rotated': 1.05,
    'outliers': 1.1, 'bias': 1.02, 'noise too small': 0.9, 'noise too large': 0.9,
    'process noise too small': 0.85, 'process noise too large': 0.85,
    'parameter': 0.9, 'scale': 0.25, 'input gain': 1.02, 'input sign': 1.1,
}  # fmt: skip
#: Where a filter is lost, a part of any gain is more than what one cause explains beyond another.
_MOST_FAVOUR = 3000.0
#: At most this many causes are looked for, and tried for one, and of one kind.
_ROUNDS, _TRIED, _ALIKE = 6, 5, 2
#: Other candidates are tried if they promise this part of the best reduction; the second where
#: promises hold: of a filter that is not lost, and of reductions that are not chance in part.
_CLOSE, _CLOSER, _SURE = 0.4, 0.6, 1000.0
#: A change is proven by a replay of the first seconds, if it explains this part of the misfit:
#: less does not show beside the faults that are still in.
PROOF, _PROVEN = 20.0, 0.01
#: A gain below this part of all numbers read is of no account, whatever its significance.
_RELEVANT = 0.002


@dataclass(frozen=True)
class Diagnosis:
    """What was found, ranked, and notes that are no faults; misfit before and after it all."""

    findings: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    before: float
    after: float


def diagnose(evidence: Evidence, progress: Callable[[str], None] = lambda what: None) -> Diagnosis:
    """Return what is wrong with a recording and its parameters.

    Parameters
    ----------
    evidence
        The recording, and what the estimator made of it.
    progress
        Called with what is looked at.
    """
    before = misfit(evidence)
    progress('stamps, rates and values')
    found, case = _plain(evidence)
    if not case.passage.events:
        return Diagnosis(_ranked(found), (), before, before)
    notes = tuple(unobserved_states.find(case))
    found += gates.find(case)
    for number in range(_ROUNDS):
        progress(f'causes of the misfit, {number + 1}')
        best = _best(case, found)
        if best is None:
            break
        finding, case = best
        found.append(finding)
    progress('proofs')
    proven = tuple(_proven(evidence, finding) for finding in _ranked(found))
    return Diagnosis(proven, notes, before, case.passage.misfit)


def _plain(evidence: Evidence) -> tuple[list[Finding], Examination]:
    """Return what shows without a filter, with what its correction gains, and all corrected."""
    found: list[Finding] = []
    case = Examination(evidence, strict=False)
    for detector in PLAIN:
        while finding := next((f for f in detector(case) if _is_new(f, found)), None):
            if finding.mended is not None:
                after = Examination(finding.mended(), strict=False, known=finding.passage)
                if finding.passage is None:  # else it is the same pass
                    gain = max(0.0, explained(case.passage, after.passage))
                    finding = replace(finding, gain=gain)
                case = after
            found.append(finding)
    return found, case


def _is_new(finding: Finding, known: Sequence[Finding]) -> bool:
    return not any(same(finding, other) for other in known)


def same(one: Finding, other: Finding) -> bool:
    """Return whether two findings have the same kind and subject."""
    return (one.kind, one.subject) == (other.kind, other.subject)


def _best(case: Examination, known: Sequence[Finding]) -> tuple[Finding, Examination] | None:
    """Return the finding that explains most, with what it really gains, and the case after it."""
    numbers = sum(len(e) for e in case.passage.whitened)
    least = max(CHANCE, _RELEVANT * numbers)
    promised = [finding for detector in FITTED for finding in detector(case)]
    promised.sort(key=_promise, reverse=True)
    tried: list[tuple[Finding, Examination]] = []
    sure = bool(promised) and _promise(promised[0]) > _SURE and not gross.lost(case)
    close = _CLOSER if sure else _CLOSE
    # what passes have shown first: where a filter is lost, regressions promise anything
    shown = gross.find(case)
    others = [f for f in promised if _is_new(f, (*known, *shown))]
    for finding in [*shown, *_few_of_a_kind(others)][:_TRIED]:
        if finding.gain <= least or not _is_new(finding, known):
            continue
        best = max((_promise(other) for other, _ in tried), default=0.0)
        if finding not in shown and _promise(finding) < close * best:
            break
        after = Examination(finding.mended(), known=finding.passage) if finding.mended else case
        try:
            gain = explained(case.passage, after.passage) - finding.dues
        except np.linalg.LinAlgError:
            continue
        if gain > least:
            tried.append((replace(finding, gain=gain), after))
    if not tried:
        return None
    finding, after = max(tried, key=lambda each: _promise(each[0]))
    alike = [
        (other.kind, other.subject)
        for other, _ in tried
        if other.gain > 0.85 * finding.gain and not same(other, finding)
    ]
    return replace(finding, same_as=(*finding.same_as, *alike)), after


def _few_of_a_kind(found: Sequence[Finding]) -> list[Finding]:
    """Return the first of each kind, so that no kind leaves the others untried."""
    seen: Counter[str] = Counter()
    few = []
    for finding in found:
        seen[finding.kind] += 1
        if seen[finding.kind] <= _ALIKE:
            few.append(finding)
    return few


def _promise(finding: Finding) -> float:
    favoured = finding.gain * SIMPLER.get(finding.kind, 1.0)
    return min(favoured, finding.gain + _MOST_FAVOUR)


def _proven(evidence: Evidence, finding: Finding) -> Finding:
    """Return a finding with what a replay with its change alone gains in the first seconds."""
    if not finding.change or 0.0 < finding.share < _PROVEN:
        return finding
    try:
        after = evidence.rerun(finding.change, PROOF)
    except ValueError:
        return replace(finding, change={})
    return replace(finding, proof=improvement(evidence, after))


def _ranked(found: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings with their shares: silent sensors, what explains most, the plain ones."""
    total = sum(max(0.0, finding.gain) for finding in found)
    shared = [
        replace(finding, share=max(0.0, finding.gain) / total if total > 0.0 else 0.0)
        for finding in found
    ]
    return tuple(sorted(shared, key=lambda f: (not f.silent, -_promise(f))))
