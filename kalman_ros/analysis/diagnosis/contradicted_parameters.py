# SPDX-License-Identifier: Apache-2.0
"""Parameters of the model that the data contradict."""

from __future__ import annotations

from functools import partial

import numpy as np

from .examination import CHANCE, Examination
from .finding import Finding
from .hypotheses import value_of

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
        value, step = value_of(case.evidence, name), float(fit.size[0])
        if abs(step) < _RELEVANT * max(abs(value), 1e-9):
            continue
        change = {f'model_parameters.{name}': float(f'{value + step:.3g}')}
        try:
            case.evidence.adopting(change)
        except ValueError:
            continue
        findings.append(
            Finding(
                'parameter',
                name,
                f'the data contradict {name}: {value + step:.3g} +- {fit.std[0]:.1g} fits, '
                f'{value:g} is configured.',
                fit.gain**0.5,
                change,
                gain=fit.gain,
                mended=partial(case.evidence.adopting, change),
            )
        )
    return findings
