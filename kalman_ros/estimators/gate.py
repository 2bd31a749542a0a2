# SPDX-License-Identifier: Apache-2.0
"""The gate: accepts, weakens or rejects a reading, and recovers from a wrong estimate."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor

from . import agreement
from .diffuse import Diffuse
from .filter import Correction, Filter
from .outcome import Outcome
from .policy import Policy
from .reading_noise import Adaptation, adaptation, softening

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
        self._sensors = dict(sensors)
        self._limits = [limits(name, policy) for name in sensors]
        self._adaptations = [
            adaptation_of(name, sensor, policy) for name, sensor in sensors.items()
        ]
        self._needed = policy.recover_after
        self._memory = round(policy.max_gap * 1e9) or inf

    @property
    def agreeing(self) -> list[float]:
        """Largest NIS of a reading of each sensor that counts in full."""
        return [soft for soft, _ in self._limits]

    def correct(
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
        soft, gate = self._limits[order]
        record, adaptation = records[order], self._adaptations[order]
        if adaptation is not None:
            sensor = sensor.with_covariance(record.noise * sensor.covariance)
        elif record.noise != 1.0:
            record = record._replace(noise=1.0)
        correction = filter.correct(belief, y, sensor)
        agrees = soft == inf or correction.nis <= soft
        if not agrees and not isfinite(correction.nis):
            raise np.linalg.LinAlgError('the innovation is not finite')
        fused = agrees or correction.nis <= gate
        if fused and adaptation is not None:
            noise = adaptation.after(record.noise, correction, sensor.covariance)
            record = record._replace(noise=float(noise))
        records = agreement.replaced(records, order, record.after(time, agrees))
        if agrees:
            return Outcome.FUSED, correction, records
        refused, recovery = self._doubted(filter, belief, y, sensor, order, records)
        if recovery is not None:
            return Outcome.RECOVERED, *recovery
        if fused:
            soft_correction = weakened(filter, belief, y, sensor, correction, soft)
            return Outcome.WEAKENED, soft_correction, records
        return refused, correction, records

    def _doubted(
        self,
        filter: Filter,
        belief: Gaussian,
        y: Array,
        sensor: Sensor,
        order: int,
        records: agreement.Records,
    ) -> tuple[Outcome, tuple[Correction, agreement.Records] | None]:
        """Return how a reading that does not agree is refused, or the recovery of the belief."""
        needed = 0 if isinstance(belief, Diffuse) else self._needed
        if not needed or sum(record.rejections for record in records) < needed:
            return Outcome.REJECTED, None
        seen = agreement.seen_states(self._sensors, belief)
        finding = agreement.judge(records, seen, order, needed, self._memory)
        refused = records[order].rejections >= needed and bool(
            np.any(finding.vouched & seen[order])
        )
        outcome = Outcome.OUTVOTED if refused else Outcome.REJECTED
        if finding.outvoted or not finding.enough:
            return outcome, None
        soft, _ = self._limits[order]
        recovered = _widened(filter, belief, y, sensor, finding.vouched, soft)
        if recovered is None:
            return outcome, None
        return outcome, (recovered, agreement.after_recovery(records, seen, ~finding.vouched))


def limits(name: str, policy: Policy) -> tuple[float, float]:
    """Return the largest NIS of a reading that agrees, and of one that is fused."""
    gate = (policy.gates or {}).get(name, inf)
    return min((policy.soft_gates or {}).get(name, inf), gate), gate


def adaptation_of(name: str, sensor: Sensor, policy: Policy) -> Adaptation | None:
    """Return how the noise of a sensor follows its innovations; None if it does not."""
    if name not in policy.adaptive:
        return None
    return adaptation(len(sensor.covariance), *limits(name, policy))


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
