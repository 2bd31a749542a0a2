# SPDX-License-Identifier: Apache-2.0
"""Sensors that are not at the place of the body where they are declared."""

from __future__ import annotations

from functools import partial

import numpy as np

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .responses import Fit

#: A lever arm (m) below this is no finding.
_RELEVANT = 0.02


def find(case: Examination) -> list[Finding]:
    """Return the sensors that read as if they were elsewhere on the body.

    What an arm adds turns with the body, so that it is no constant offset of the readings.
    """
    findings = []
    for name in case.judged:
        fit = _fit(case, name)
        if fit is not None and fit.gain >= CHANCE and np.abs(fit.size).max() >= _RELEVANT:
            finding = _moved(case, name, fit)
            if finding is not None:
                findings.append(finding)
    return findings


def _fit(case: Examination, name: str) -> Fit | None:
    """Return the fit of how much farther along each axis the sensor is (3,)."""
    columns = case.responses.columns('arm', name)
    return case.responses.together(columns) if columns else None


def _moved(case: Examination, name: str, fit: Fit) -> Finding | None:
    """Return the finding that a sensor is farther by the fitted arm; None if it may not be."""
    evidence = case.evidence
    key = f'{name}.mount.translation'
    before = np.asarray(evidence.parameters.get(key, [0.0, 0.0, 0.0]), dtype=float)
    arm = before + fit.size
    change = {key: [float(f'{value:.4g}') for value in arm]}
    try:
        evidence.adopting(change)
    except ValueError:
        return None
    columns = case.responses.columns('arm', name)
    shown = case.responses.information[columns, columns] > 0.0
    words = ', '.join(
        f'{value:+.4g} ± {std:.1g} m {axis}'
        for value, std, axis, is_shown in zip(arm, fit.std, ('forward', 'left', 'up'), shown)
        if is_shown
    )

    def again(after: Examination) -> Finding | None:
        more = _fit(after, name)
        if more is None or not more.remains:
            return None
        return _moved(after, name, more)

    return Finding(
        'lever arm', name,
        f'readings of {name} are those of another place on the body: {words} of where it is '
        'declared to be.',
        fit.gain**0.5, change, gain=fit.gain, parameters=int(shown.sum()),
        mended=partial(Evidence.adopting, evidence, change), again=again,
    )  # fmt: skip
