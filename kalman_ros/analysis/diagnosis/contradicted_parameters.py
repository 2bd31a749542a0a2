# SPDX-License-Identifier: Apache-2.0
"""Parameters of the model that the data contradict."""

from __future__ import annotations

from functools import partial

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .hypotheses import value_of
from .responses import Fit

#: Relative changes below this are no finding.
_RELEVANT = 0.03


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
        value = value_of(case.evidence, name)
        if abs(float(fit.size[0])) < _RELEVANT * max(abs(value), 1e-9):
            continue
        finding = _changed(case.evidence, name, value, fit)
        if finding is not None:
            findings.append(finding)
    return findings


def _changed(evidence: Evidence, name: str, value: float, fit: Fit) -> Finding | None:
    """Return the finding that a parameter is a step from ``value`` away; None if invalid."""
    fitted = value + float(fit.size[0])
    change = {f'model_parameters.{name}': float(f'{fitted:.3g}')}
    try:
        evidence.adopting(change)
    except ValueError:
        return None

    def again(after: Examination) -> Finding | None:
        column = after.responses.columns('parameter', name)
        more = after.responses.alone(column[0]) if column else None
        if more is None or not abs(float(more.size[0])) > 2.0 * float(more.std[0]):
            return None
        return _changed(evidence, name, value_of(after.evidence, name), more)

    return Finding(
        'parameter',
        name,
        f'the data contradict {name}: {fitted:.3g} +- {fit.std[0]:.1g} fits, '
        f'{value_of(evidence, name):g} is configured.',
        fit.gain**0.5,
        change,
        gain=fit.gain,
        mended=partial(evidence.adopting, change),
        again=again,
    )
