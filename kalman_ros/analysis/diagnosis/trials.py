# SPDX-License-Identifier: Apache-2.0
"""Causes that were tried on one case, by filter passes, and how sure the best one is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import exp, log, sqrt

import numpy as np

from .examination import CHANCE, Examination
from .finding import Finding
from .passage import Passage, explained

#: How often the size of a finding is fitted again.
_REFINED = 3
#: By how much the likelihood is tempered, as a share of the gain.
_TEMPER = 0.15
#: Odds that a first finding is right which explains as much as all others together.
_ODDS = 12.0
#: The share of the best gain from which another cause fits as well.
TIED = 0.85
#: A mean square of innovations this near to 1 is that of a filter that is right.
_CONSISTENT = 0.03
#: A gain below this share of the number of values read is irrelevant, even if it is significant.
_RELEVANT = 0.002


class Trials:
    """Causes that were tried on a case, the best one, and the case corrected by it."""

    def __init__(self, case: Examination) -> None:
        count = int(case.passage.sizes.sum())
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
        self.tried[cause] = max(
            finding, self.tried.get(cause, finding), key=lambda trial: trial.gain
        )
        if self.best is None or gain > self.best.gain:
            self.best, self.after = finding, after

    def add_nearer(self, finding: Finding, after: Examination) -> None:
        """Add a finding with a better size.

        The size is that of a linearisation. It is fitted again about the corrected case, as long
        as the gain grows (Newton's method).
        """
        finding = replace(finding, gain=self.gain(finding, after))
        for _ in range(_REFINED):
            better = finding.again and finding.again(after.about(finding.concerned))
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
        tied = [(f.kind, f.subject) for f in rivals if f.gain > TIED * finding.gain]
        return replace(
            finding, certainty=min(share * whole, finding.most), same_as=(*finding.same_as, *tied)
        ), self.after


def same(one: Finding, other: Finding) -> bool:
    """Return whether two findings have the same kind and subject."""
    return (one.kind, one.subject) == (other.kind, other.subject)


def certainty(gain: float, rivals: Iterable[float]) -> float:
    """Return the posterior share of a cause, and of those that fit as well, among its rivals.

    The gains of rivals are differences of the Bayesian information criterion, so that weights are
    exp(gain / 2) (R. Kass and A. Raftery, Bayes Factors, J. American Statistical Association 90,
    1995), of a likelihood that is tempered by `_TEMPER` of the gain: no model is exact, and its
    error grows with the misfit.
    """
    scale = 2.0 + _TEMPER * gain
    weights = [(other, exp(min(0.0, other - gain) / scale)) for other in rivals]
    tied = 1.0 + sum(weight for other, weight in weights if other > TIED * gain)
    return tied / (1.0 + sum(weight for _, weight in weights))


def calibrated(share: float) -> float:
    """Return how often a first finding with a share of the explanation is right.

    Its odds are `_ODDS` times the root of those of the share: a logistic recalibration (J. Platt,
    Probabilistic Outputs for Support Vector Machines, 1999) by 217 first findings, on the eleventh
    and the twelfth set of foreign systems at their first sight, and on faults in real recordings.
    The likeliest one is 22 times the power 0.36; this one is within 0.7 of its log likelihood, and
    less sure.
    """
    if share in (0.0, 1.0):
        return share
    odds = _ODDS * sqrt(share / (1.0 - share))
    return odds / (1.0 + odds)


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
