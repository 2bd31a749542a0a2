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
from .passage import explained
from .responses import Fit

#: Longest step of a logarithm, and the shares of a step that are tried.
_FARTHEST, _SHARES = 10.0, (1.0, 0.5, 0.25)


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
        found = parameter(case.evidence, name)
        finding = _changed(case, found, fit, found.value)
        if finding is not None:
            findings.append(finding)
    return findings


def _changed(case: Examination, found: Parameter, fit: Fit, configured: float) -> Finding | None:
    """Return the finding that a parameter is a fitted step away; None if that is invalid.

    A step beyond the range of a parameter, such as below zero, is taken in its logarithm, and
    shortened to what explains most.
    """
    fitted = found.value + float(fit.size[0])
    if _is_valid(case.evidence, found.change(fitted)):
        return _stepped(case, found, fit, fitted, configured)
    if not found.value:
        return None
    step = min(float(fit.size[0]) / found.value, _FARTHEST)
    trials = [found.value * exp(share * step) for share in _SHARES]
    valid = [each for each in trials if _is_valid(case.evidence, found.change(each))]
    if not valid:
        return None

    def best() -> Finding:
        candidates = [_stepped(case, found, fit, each, configured) for each in valid]
        return max(candidates, key=partial(_explained, case))

    return replace(_stepped(case, found, fit, valid[0], configured), exact=best)


def _stepped(
    case: Examination, found: Parameter, fit: Fit, fitted: float, configured: float
) -> Finding:
    """Return the finding that a parameter has a fitted value."""
    name, change = found.name, found.change(fitted)

    def again(after: Examination) -> Finding | None:
        column = after.responses.columns('parameter', name)
        more = after.responses.alone(column[0]) if column else None
        if more is None or not abs(float(more.size[0])) > 2.0 * float(more.std[0]):
            return None
        return _changed(after, parameter(after.evidence, name), more, configured)

    return Finding(
        'parameter',
        name,
        f'the data contradict {name}: {fitted:.3g} ± {fit.std[0]:.1g} fits, '
        f'{configured:g} is configured.',
        fit.gain**0.5,
        change,
        gain=fit.gain,
        mended=partial(case.evidence.adopting, change),
        again=again,
    )


def _explained(case: Examination, finding: Finding) -> float:
    """Return what the correction of a finding explains; nothing if the filter fails with it."""
    assert finding.mended is not None
    try:
        return explained(case.passage, Examination(finding.mended()).passage)
    except np.linalg.LinAlgError:
        return -np.inf


def _is_valid(evidence: Evidence, change: Mapping[str, Any]) -> bool:
    """Return whether the parameters of a file may have a change."""
    try:
        evidence.adopting(change)
    except ValueError:
        return False
    return True
