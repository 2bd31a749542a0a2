# SPDX-License-Identifier: Apache-2.0
"""Parameters of the model that the data contradict."""

from __future__ import annotations

from functools import partial

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .parameters import Parameter, parameter
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
        found = parameter(case.evidence, name)
        if abs(float(fit.size[0])) < _RELEVANT * max(abs(found.value), 1e-9):
            continue
        finding = _changed(case.evidence, found, fit)
        if finding is not None:
            findings.append(finding)
    return findings


def _changed(evidence: Evidence, found: Parameter, fit: Fit) -> Finding | None:
    """Return the finding that a parameter is a fitted step away; None if that is invalid."""
    name, fitted = found.name, found.value + float(fit.size[0])
    change = found.change(fitted)
    try:
        evidence.adopting(change)
    except ValueError:
        return None

    def again(after: Examination) -> Finding | None:
        column = after.responses.columns('parameter', name)
        more = after.responses.alone(column[0]) if column else None
        if more is None or not abs(float(more.size[0])) > 2.0 * float(more.std[0]):
            return None
        return _changed(evidence, parameter(after.evidence, name), more)

    return Finding(
        'parameter',
        name,
        f'the data contradict {name}: {fitted:.3g} ± {fit.std[0]:.1g} fits, '
        f'{parameter(evidence, name).value:g} is configured.',
        fit.gain**0.5,
        change,
        gain=fit.gain,
        mended=partial(evidence.adopting, change),
        again=again,
    )
