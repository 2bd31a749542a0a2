# SPDX-License-Identifier: Apache-2.0
"""The gate: accepts, weakens or rejects a reading, and recovers from a wrong estimate."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

from . import agreement
from .filter import Correction, Filter
from .outcome import Outcome
from .policy import Policy
from .reading_noise import adapted, softening

#: Each widening doubles the standard deviations, which so grow by up to a factor of a million.
_MOST_WIDENINGS = 20


class Gate:
    """Correct a belief by a reading or reject it; widen the belief after too many rejections.

    Parameters
    ----------
    sensors
        Sensors by name, in the order of ``records``.
    policy
        Largest NIS of each sensor that is fused, and that counts in full; whose noise is adapted;
        and the number of rejections before recovery.
    """

    def __init__(self, sensors: Mapping[str, Sensor], policy: Policy) -> None:
        order = {name: index for index, name in enumerate(sensors)}
        self._sensors = dict(sensors)
        self._gates = {order[name]: gate for name, gate in (policy.gates or {}).items()}
        self._soft = {order[name]: gate for name, gate in (policy.soft_gates or {}).items()}
        self._adaptive = {order[name] for name in policy.adaptive}
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
            Filter, and the belief before the reading.
        y, sensor
            Reading (k,) and its sensor.
        at
            Time of the reading in nanoseconds, and the index of its sensor.
        records
            Records of the earlier outcomes, by sensor.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the correction cannot be computed.
        """
        time, order = at
        record = records[order]
        if order in self._adaptive:
            sensor = sensor.with_covariance(record.noise * sensor.covariance)
        correction = filter.correct(belief, y, sensor)
        gate = self._gates.get(order)
        if gate is None or correction.nis <= gate:
            limit, outcome = self._soft.get(order), Outcome.FUSED
            if order in self._adaptive:
                noise = adapted(record.noise, correction, sensor.covariance, limit)
                record = record._replace(noise=float(noise))
            if limit is not None and limit < correction.nis < inf:
                outcome = Outcome.WEAKENED
                correction = weakened(filter, belief, y, sensor, correction, limit)
            records = agreement.replaced(records, order, record.after(time, True))
            return outcome, correction, records
        if not isfinite(correction.nis):
            raise np.linalg.LinAlgError('the innovation is not finite')
        records = agreement.replaced(records, order, records[order].after(time, False))
        needed = self._needed
        if not needed or sum(record.rejections for record in records) < needed:
            return Outcome.REJECTED, correction, records
        seen = agreement.seen_states(self._sensors, belief)
        finding = agreement.judge(records, seen, order, needed, self._memory)
        refused = records[order].rejections >= needed and bool(
            np.any(finding.vouched & seen[order])
        )
        rejected = Outcome.OUTVOTED if refused else Outcome.REJECTED
        if finding.outvoted or not finding.enough:
            return rejected, correction, records
        recovered = _widened(filter, belief, y, sensor, finding.vouched, gate)
        if recovered is None:
            return rejected, correction, records
        return (
            Outcome.RECOVERED,
            recovered,
            agreement.after_recovery(records, seen, ~finding.vouched),
        )


def weakened(
    filter: Filter, belief: Gaussian, y: Array, sensor: Sensor, full: Correction, limit: float
) -> Correction:
    """Return a correction by a reading that counts as if it were at a ``limit`` of its NIS.

    Innovation, its covariance and NIS remain those of the ``full`` correction: they tell how far
    away the reading is.
    """
    R = sensor.covariance
    factor = softening(full, R, limit)[..., np.newaxis, np.newaxis]
    soft = filter.correct(belief, y, sensor.with_covariance(factor * R))
    S = full.innovation_covariance
    return Correction(soft.posterior, full.innovation, S, soft.gain, soft.jacobian, full.nis)


def _widened(
    filter: Filter,
    belief: Gaussian,
    y: Array,
    sensor: Sensor,
    vouched: agreement.Mask,
    gate: float,
) -> Correction | None:
    """Widen the doubted states until the reading passes; return its correction."""
    factor = np.where(vouched, 1.0, 2.0)
    for _ in range(_MOST_WIDENINGS):
        covariance = np.outer(factor, factor) * belief.covariance
        belief = belief._replace(covariance=covariance)
        correction = filter.correct(belief, y, sensor)
        if correction.nis <= gate:
            return correction
    return None
