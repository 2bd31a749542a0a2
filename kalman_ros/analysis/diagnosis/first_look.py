# SPDX-License-Identifier: Apache-2.0
"""A short part of a recording, so that there is a first answer within seconds.

The part begins where the innovations of the replay begin to exceed what is expected, which a
cumulative sum finds (E. S. Page, Continuous Inspection Schemes, Biometrika 41, 1954). Until then
the belief of the replay is right, and the part starts from it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalman_ros.core import Array, Gaussian

from .evidence import Evidence

#: Number of readings of the part, and the smallest number of a recording that has such a part.
READINGS, _LONG = 800, 2500
#: Normalised squares are limited to the first number of times their expectation; the sum grows by
#: what exceeds the second, and has to reach the third.
_OUTLYING, _EXPECTED, _ALARM = 10.0, 1.5, 60.0


def part(evidence: Evidence) -> tuple[Evidence, float, float] | None:
    """Return the evidence of a part, and its begin and end in s; None of a short recording.

    Parameters
    ----------
    evidence
        Recording, and the results of the estimator.
    """
    times, excess = _excess(evidence)
    if len(times) < _LONG:
        return None
    onset = begins(excess) if len(evidence.beliefs.time) else None
    first = 0 if onset is None or onset < READINGS else min(onset, len(times) - READINGS)
    begin, end = times[first], times[min(first + READINGS, len(times) - 1)]
    excerpt = evidence.between(begin, end)
    if first:
        belief = _belief_before(evidence, begin)
        excerpt = replace(excerpt, scenario=replace(excerpt.scenario, initial_belief=belief))
    return excerpt, float(begin - evidence.start), float(end - evidence.start)


def begins(excess: Array) -> int | None:
    """Return the index from which the sum of an excess (N,) grows to an alarm, or None."""
    total = np.cumsum(excess)
    lowest = np.minimum.accumulate(np.concatenate(([0.0], total)))[:-1]
    alarms = np.flatnonzero(total - lowest > _ALARM)
    if not len(alarms):
        return None
    before = np.concatenate(([0.0], total))[: alarms[0] + 1]
    return int(np.argmin(before))


def _excess(evidence: Evidence) -> tuple[Array, Array]:
    """Return when readings with an innovation were received, and by how much each is too large."""
    received, squares = [np.zeros(0)], [np.zeros(0)]
    for record in evidence.sensors.values():
        known, k = np.isfinite(record.nis), record.value.shape[1]
        received.append(record.received[known])
        squares.append(np.minimum(record.nis[known], _OUTLYING * k) - _EXPECTED * k)
    every = np.concatenate(received)
    order = np.argsort(every, kind='stable')
    return every[order], np.concatenate(squares)[order]


def _belief_before(evidence: Evidence, time: float) -> Gaussian:
    """Return the belief of the replay before a time, without the biases that it follows."""
    beliefs, n = evidence.beliefs, evidence.scenario.model.state.size
    index = max(int(np.searchsorted(beliefs.time, time)) - 1, 0)
    return Gaussian(beliefs.mean[index, :n], beliefs.covariance[index, :n, :n])
