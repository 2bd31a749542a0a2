# SPDX-License-Identifier: Apache-2.0
"""Occasional readings with a large error."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import gammainccinv

from kalman_ros.core import Array

from .examination import CHANCE, Examination
from .filter_pass import rejected
from .finding import Curve, Figure, Finding
from .passage import DROPPED

#: Probability of an outlier under the declared noise, and largest share of outliers.
_RARE, _MOST = 1e-6, 0.25
#: Number of outliers in a row, on average, from which something disturbs the sensor for a time.
_CLUSTERED = 8


def find(case: Examination) -> list[Finding]:
    """Return the sensors of which a few readings have large errors and the others have not.

    The limit follows from the median of the normalised innovations squared, which outliers hardly
    change (F. Hampel, The Influence Curve and its Role in Robust Estimation, J. American
    Statistical Association 69, 1974).
    """
    findings = []
    for name in case.judged:
        finding = _find_outliers(case, name)
        if finding is not None:
            findings.append(finding)
    return findings


def _find_outliers(case: Examination, name: str) -> Finding | None:
    events, squares = case.passage.of(name), case.passage.squares(name)
    if len(events) < 20:
        return None
    k = int(case.passage.sizes[events[0]])
    typical = max(1.0, float(np.median(squares) / (2.0 * gammainccinv(k / 2.0, 0.5))))
    limit = typical * 2.0 * float(gammainccinv(k / 2.0, _RARE))
    if not (squares > limit).any():
        return None
    rows = rejected(case.evidence, name, limit)
    share = len(rows) / len(events)
    indices = case.passage.series('index', name)
    gain = float(np.sum(squares[np.isin(indices, rows)] - k - DROPPED))
    kept = squares[~np.isin(indices, rows)]
    gain += float(np.sum(kept[kept > limit] - k))
    if not 0.0 < share <= _MOST or gain < CHANCE:
        return None
    usual = float(np.median(squares[np.isin(indices, rows)]))
    if usual < k + DROPPED:  # a gate that locks out rejects what fits
        return None
    size = float(np.sqrt(usual / k))
    gate = case.evidence.scenario.sensors[name].gate
    change, remedy = {}, 'Its gate is there to reject them.'
    if gate >= 1.0:
        change, remedy = {f'{name}.gate': 0.9999}, 'A gate rejects them.'
    runs = runs_of(np.isin(indices, rows))
    together = len(rows) >= _CLUSTERED * runs
    course = f', in {runs} stretch{"es" if runs > 1 else ""}' if together else ''
    return Finding(
        'disturbed' if together else 'outliers', name,
        f'{len(rows)} of {len(events)} readings of {name} ({100.0 * share:.2g} %) are outliers'
        f'{course}, about {size:.2g} standard deviations off. {remedy}',
        gain**0.5, change, gain=gain, figure=_picture(case, name, events, squares, limit),
        mended=lambda: case.evidence.without(name, rows),
    )  # fmt: skip


def runs_of(mask: Any) -> int:
    """Return the number of runs of True in a mask (N,)."""
    padded = np.concatenate(([False], mask))
    return int(np.sum(~padded[:-1] & padded[1:]))


def _picture(case: Examination, name: str, events: Array, squares: Array, limit: float) -> Figure:
    times = case.passage.series('time', name) - case.evidence.start
    curves = (
        Curve('NIS', times, squares, 'dots'),
        Curve('limit', times[[0, -1]], np.full(2, limit), 'bound'),
    )
    return Figure(f'{name}: normalised innovations squared', 'time [s]', 'NIS', curves)
