# SPDX-License-Identifier: Apache-2.0
"""Parameters of the model that the data contradict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import exp
from typing import Any

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .parameters import Parameter, parameter
from .responses import Fit
from .tested import likelier, tested

#: Longest step of a logarithm, the shares of a step that are tried, and the share of its promised
#: gain from which a step holds.
_FARTHEST, _SHARES, _HOLDS = 10.0, (1.0, 0.5, 0.25), 0.5


def find(case: Examination) -> list[Finding]:
    """Return the parameters whose change explains the innovations, each by a regression.

    The change is one Newton step of the likelihood (Gupta and Mehra, 1974). The replay that proves
    a finding shows how well the linearisation holds.
    """
    findings = []
    for column in case.responses.columns('parameter'):
        name = case.responses.labels[column][1]
        fit = case.responses.alone(column)
        if fit.gain < CHANCE or not np.isfinite(fit.size[0]):
            continue
        candidate = parameter(case.evidence, name)
        finding = _changed(case, candidate, fit, candidate.value)
        if finding is not None:
            findings.append(finding)
    return findings


def _changed(
    case: Examination, candidate: Parameter, fit: Fit, configured: float, before: float = 1.0
) -> Finding | None:
    """Return the finding that a parameter is a fitted step away; None if that is invalid.

    A ``candidate`` that is a factor multiplies what an earlier step left, ``before`` times the
    first.

    A step beyond the range of a parameter, such as below zero, is taken in its logarithm, and so
    is one after which the filter does not explain what it promises: then in shares, too.
    """
    trials = [candidate.value + float(fit.size[0])]
    if candidate.value:
        step = min(max(float(fit.size[0]) / candidate.value, -_FARTHEST), _FARTHEST)
        trials += [candidate.value * exp(share * step) for share in _SHARES]
    valid = [value for value in trials if _is_valid(case.evidence, candidate.change(value))]
    if not valid:
        return None
    steps = [_stepped(case, candidate, fit, value, configured, before) for value in valid]

    def best() -> Finding:
        explains, first = tested(case, steps[0])
        if valid[0] == trials[0] and explains > _HOLDS * fit.gain:
            return first
        return likelier(case, *steps)

    return replace(steps[0], exact=best)


def _stepped(
    case: Examination,
    candidate: Parameter,
    fit: Fit,
    fitted: float,
    configured: float,
    before: float,
) -> Finding:
    """Return the finding that a parameter has a fitted value."""
    name, change, std = candidate.name, candidate.change(fitted), before * float(fit.std[0])
    factor = before * fitted if candidate.row else 1.0

    def again(after: Examination) -> Finding | None:
        more = after.responses.first('parameter', name)
        if more is None or not more.remains:
            return None
        return _changed(after, parameter(after.evidence, name), more, configured, factor)

    wrong = f'{name}: {fitted:.4g} ± {std:.1g} fits, {configured:g} is configured.'
    if candidate.row:
        wrong = (
            f'the row of {candidate.row} in A and B: {factor:.4g} ± {std:.1g} times that row '
            'fits, as with another mass or time constant.'
        )
    return Finding(
        'parameter',
        name,
        f'the data contradict {wrong}',
        fit.gain**0.5,
        change,
        gain=fit.gain,
        mended=partial(case.evidence.adopting, change),
        again=again,
    )


def _is_valid(evidence: Evidence, change: Mapping[str, Any]) -> bool:
    """Return whether the parameters of a file may have a change."""
    try:
        evidence.adopting(change)
    except ValueError:
        return False
    return True
