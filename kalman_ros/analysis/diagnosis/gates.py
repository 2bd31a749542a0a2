# SPDX-License-Identifier: Apache-2.0
"""Gates that reject good data."""

from __future__ import annotations

import numpy as np
from scipy.special import bdtrc

from kalman_ros.estimators.outcome import Outcome

from .examination import Examination
from .finding import Curve, Figure, Finding

#: Readings that a gate rejects are good if without it their NIS are of one distribution with
#: those of the others: their median is above that of all by no more than this factor.
_GOOD = 15.0
_REJECTED = (Outcome.REJECTED.name, Outcome.OUTVOTED.name)


def find(case: Examination) -> list[Finding]:
    """Return the gates that reject far more than they should, of readings that are good."""
    found = []
    for name, record in case.evidence.sensors.items():
        gate = case.evidence.scenario.sensors[name].gate
        rejected = np.isin(record.outcome, _REJECTED)
        count = int(rejected.sum())
        expected = (1.0 - gate) * len(record)
        if count <= 3.0 * expected + 3.0 or bdtrc(count, len(record), 1.0 - gate) > 1e-7:
            continue
        squares = {
            case.passage.events[i].index: float(
                case.passage.whitened[i] @ case.passage.whitened[i]
            )
            for i in case.passage.of(name)
        }
        refused = [square for index, square in squares.items() if rejected[index]]
        if not refused or np.median(refused) > _GOOD * np.median([*squares.values()]):
            continue
        when = record.received - case.evidence.start
        change = {f'{name}.gate': 1.0}
        found.append(
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
                        Curve('NIS', when, record.nis, 'dots'),
                        Curve('rejected', when[rejected], record.nis[rejected], 'dots'),
                    ),
                ),
            )
        )
    return found
