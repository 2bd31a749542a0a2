# SPDX-License-Identifier: Apache-2.0
"""The gate: accepts or rejects a reading, and recovers from a wrong estimate."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

from . import agreement
from .filter import Correction, Filter
from .outcome import Outcome
from .policy import Policy

#: Widening by four each time, this increases standard deviations by up to a million.
_MOST_WIDENINGS = 20


class Gate:
    """Corrects a belief by a reading, or rejects it; widens the belief after too many rejections.

    Parameters
    ----------
    sensors
        By name, in the order of ``records``.
    policy
        The largest NIS per sensor, and the number of rejections before recovery.
    """

    def __init__(self, sensors: Mapping[str, Sensor], policy: Policy) -> None:
        order = {name: index for index, name in enumerate(sensors)}
        self._sensors = dict(sensors)
        self._gates = {order[name]: gate for name, gate in (policy.gates or {}).items()}
        self._needed = policy.recover_after
        self._memory = round(policy.max_gap * 1e9) or inf

    def __call__(
        self,
        filter: Filter,
        belief: Gaussian,
        y: Array,
        sensor: Sensor,
        at: tuple[int, int],
        records: agreement.Records,
    ) -> tuple[Outcome, Correction, agreement.Records]:
        """Return the outcome of a reading ``y`` (k,), its correction and the updated records.

        Parameters
        ----------
        filter, belief
            The filter, and the belief before the reading.
        y, sensor
            The reading and its sensor.
        at
            Its time in nanoseconds, and the index of its sensor.
        records
            Earlier outcomes by sensor.

        Raises
        ------
        numpy.linalg.LinAlgError
            If there is no correction.
        """
        time, order = at
        correction = filter.correct(belief, y, sensor)
        gate = self._gates.get(order)
        if gate is None or correction.nis <= gate:
            records = agreement.replaced(records, order, records[order].after(time, True))
            return Outcome.FUSED, correction, records
        if not isfinite(correction.nis):
            raise np.linalg.LinAlgError('the innovation is not finite')
        records = agreement.replaced(records, order, records[order].after(time, False))
        needed = self._needed
        if not needed or sum(record.rejections for record in records) < needed:
            return Outcome.REJECTED, correction, records
        seen = agreement.seen_states(self._sensors, belief)
        found = agreement.judge(records, seen, order, needed, self._memory)
        refused = records[order].rejections >= needed and bool(np.any(found.vouched & seen[order]))
        rejected = Outcome.OUTVOTED if refused else Outcome.REJECTED
        if found.outvoted or not found.enough:
            return rejected, correction, records
        recovered = _widened(filter, belief, y, sensor, found.vouched, gate)
        if recovered is None:
            return rejected, correction, records
        return (
            Outcome.RECOVERED,
            recovered,
            agreement.after_recovery(records, seen, ~found.vouched),
        )


def _widened(
    filter: Filter,
    belief: Gaussian,
    y: Array,
    sensor: Sensor,
    vouched: agreement.Mask,
    gate: float,
) -> Correction | None:
    """Return the correction by a reading that passes after doubted states are widened."""
    factor = np.where(vouched, 1.0, 2.0)
    for _ in range(_MOST_WIDENINGS):
        covariance = np.outer(factor, factor) * belief.covariance
        belief = belief._replace(covariance=covariance)
        correction = filter.correct(belief, y, sensor)
        if correction.nis <= gate:
            return correction
    return None
