# SPDX-License-Identifier: Apache-2.0
"""Gates that reject good data."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import bdtrc

from kalman_ros.estimators.outcome import Outcome

from .examination import CHANCE, Examination
from .filter_pass import passage
from .finding import Curve, Figure, Finding
from .passage import explained_in_both

#: Rejected readings are good if their NIS in a pass without the gate has the same distribution as
#: that of the other readings: its median exceeds the median of all by no more than this factor.
#: And the other readings fit that pass better than one that lacks the rejected ones, or no worse
#: and the factor is no more than the second one: bad readings drag a filter to where they fit.
_GOOD, _ALIKE = 15.0, 4.0
_REJECTED = (Outcome.REJECTED.name, Outcome.OUTVOTED.name)


def _harm(case: Examination, name: str, rejected: Any) -> float:
    """Return by how much worse the other readings fit where rejected ones are fused, too."""
    without = passage(case.evidence.without(name, rejected), strict=False)
    return explained_in_both(case.passage, without)


def find(case: Examination) -> list[Finding]:
    """Return the gates that reject far more good readings than expected."""
    findings = []
    for name, record in case.evidence.sensors.items():
        gate = case.evidence.scenario.sensors[name].gate
        rejected = np.isin(record.outcome, _REJECTED)
        count = int(rejected.sum())
        expected = (1.0 - gate) * len(record)
        if count <= 3.0 * expected + 3.0 or bdtrc(count, len(record), 1.0 - gate) > 1e-7:
            continue
        squares = case.passage.squares(name)
        far = squares[rejected[case.passage.series('index', name)]]
        ratio = np.median(far) / np.median(squares) if len(far) else np.inf
        if ratio > _GOOD:
            continue
        harm = _harm(case, name, rejected)
        if harm > CHANCE or (harm > -CHANCE and ratio > _ALIKE):
            continue
        times = record.received - case.evidence.start
        change = {f'{name}.gate': 1.0}
        findings.append(
            Finding(
                'gate',
                name,
                f'the gate of {name} rejected {count} of {len(record)} readings, where '
                f'{expected:.2g} are expected, and they fit the estimate of a filter that has '
                'no gate: it locked out good data. Open it, or widen the belief it judges by.',
                np.inf,
                change,
                figure=Figure(
                    f'{name}: NIS, and what was rejected',
                    'time [s]',
                    'NIS',
                    (
                        Curve('NIS', times, record.nis, 'dots'),
                        Curve('rejected', times[rejected], record.nis[rejected], 'dots'),
                    ),
                ),
            )
        )
    return findings
