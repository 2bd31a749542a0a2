# SPDX-License-Identifier: Apache-2.0
"""A batch of estimator runs in step: readings in order, gates, missing readings, repairs.

This is `online.OnlineEstimator` for a whole batch whose readings arrive in order. Rare cases, a
covariance to repair or a gate that may recover, are left to the code for one run.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, chosen, is_finite, unchecked
from kalman_ros.core.stacked import stacked_sensor
from kalman_ros.linear.batched import squared, times, whitened

from .batch_records import NEVER, BatchRecords, Mask
from .filter import Correction, Filter, committed
from .gain_schedule import GainSchedule
from .gate import Gate, adaptation_of, limits, weakened
from .policy import Policy


def for_many(filter: Filter) -> Filter:
    """Return the filter for beliefs with leading axes, even if its model takes a single state.

    Raises
    ------
    ValueError
        If the beliefs of the filter are mixtures.
    """
    if filter.mixture:
        raise ValueError(
            'filter: expected one with a single Gaussian as its belief, such as kf, ekf or ukf, '
            f'for a batch, got {type(filter).__name__}'
        )
    return filter.stacked()


class BatchEstimator:
    """A filter on a batch whose members share the times of their readings and inputs.

    Parameters
    ----------
    filter
        Filter of one run.
    sensors
        Sensors by name, in the order in which readings of one time are fused.
    initial
        Belief at the first time; its mean is (n,) for all members, or (..., n).
    input
        Input (m,) until the first `set_input`.
    members
        Shape of the batch.
    policy
        Gates and their recovery; readings are in order and never expire.
    schedule
        `GainSchedule` of this filter, if another batch has computed one.
    """

    def __init__(
        self,
        filter: Filter,
        sensors: Mapping[str, Sensor],
        initial: Gaussian,
        input: Array,
        members: tuple[int, ...],
        policy: Policy | None = None,
        schedule: GainSchedule | None = None,
    ) -> None:
        policy = policy or Policy()
        #: Gains and covariances, shared by all members.
        self.schedule = schedule or GainSchedule(filter)
        self._one, self._filter = filter, for_many(filter)
        self._sensors = {name: stacked_sensor(sensor) for name, sensor in sensors.items()}
        self._initial, self._input = initial, input
        self._order = {name: index for index, name in enumerate(sensors)}
        self._gate = Gate(sensors, policy)
        self._limits = {name: limits(name, policy) for name in sensors}
        self._adaptations = {
            name: adaptation_of(name, sensor, policy) for name, sensor in sensors.items()
        }
        #: Whether any reading is judged by its NIS, and whether the NIS changes what is fused.
        self._judges = any(soft < np.inf for soft, _ in self._limits.values())
        self._weighs = self._judges or any(self._adaptations.values())
        self._needed = policy.recover_after
        self.members = members
        mean = np.broadcast_to(initial.mean, (*members, initial.mean.shape[-1]))
        #: Beliefs at `time`; a covariance that all members share is (n, n).
        self.belief = unchecked((_by_coordinate(mean), initial.covariance))
        #: The last covariance that was checked, and its factor.
        self._factored: tuple[Array | None, Array] = None, initial.covariance
        #: Time of the beliefs in nanoseconds; None before the first `advance`.
        self.time: int | None = None
        #: Numbers of fused and of rejected readings, by sensor and member.
        self.fused = {name: np.zeros(members, dtype=int) for name in sensors}
        self.rejected = {name: np.zeros(members, dtype=int) for name in sensors}
        self._records = BatchRecords(len(sensors), members)

    def advance(self, time: int) -> Gaussian:
        """Predict to ``time``, in nanoseconds, and return the beliefs."""
        if self.time is not None and time != self.time:
            dt = (time - self.time) * 1e-9
            self.belief = self._predicted_as_scheduled(dt) or self._predicted(dt)
        self.time = time
        return self.belief

    def set_input(self, u: Array) -> None:
        """Set the inputs (..., m) in effect from `time` on; ignore those that are not finite."""
        if not is_finite(u):
            good = np.isfinite(u * u).all(axis=-1, keepdims=True)
            u = np.where(good, u, self._input)
        self._input = u

    def add_reading(self, name: str, y: Array, present: Mask | None = None) -> Correction:
        """Fuse the readings ``y`` (..., k) at `time` of the members that are ``present``.

        A reading that is not finite counts as missing.
        """
        if present is None:
            scheduled = self._corrected_as_scheduled(name, y)
            if scheduled is not None:
                return scheduled
        prior, sensor = self.belief, self._with_noise(name)
        with np.errstate(all='ignore'):
            correction = self._filter.correct(prior, y, sensor)
            taken = np.asarray(np.isfinite(y * y).all(axis=-1))
            if present is not None:
                taken = taken & present
            soft, gate = self._limits[name]
            judged = soft < np.inf
            agreed = np.asarray(taken & (correction.nis <= soft)) if judged else taken
            passed = np.asarray(taken & (correction.nis <= gate)) if judged else taken
            doubtful = self._doubtful(taken & ~agreed, correction)
            self._adapt(name, sensor, correction, passed & ~doubtful)
            if not agreed[passed].all():
                correction = weakened(self._filter, prior, y, sensor, correction, soft)
            posterior, failed = self._committed(correction.posterior, passed)
        accepted = passed & ~failed
        if judged:
            masks = taken, agreed, passed, accepted, doubtful
            posterior, accepted = self._gated(name, y, correction, masks, posterior)
        elif self._judges:
            assert self.time is not None
            agrees = np.where(accepted, 1, NEVER)
            self._records.add(self._order[name], self.time, agrees, taken)
        self.belief = posterior if accepted.all() else chosen(accepted, posterior, prior)
        self.fused[name] += accepted
        self.rejected[name] += taken & ~accepted
        return correction

    def _with_noise(self, name: str) -> Sensor:
        """Return a sensor with the noise that its innovations have shown, for each member."""
        sensor = self._sensors[name]
        if self._adaptations[name] is None:
            return sensor
        noise = self._records.noise[self._order[name]]
        return sensor.with_covariance(noise[..., np.newaxis, np.newaxis] * sensor.covariance)

    def _adapt(self, name: str, sensor: Sensor, correction: Correction, members: Mask) -> None:
        """Let the noise of some members follow their innovations, if that of the sensor does."""
        adaptation = self._adaptations[name]
        if adaptation is not None:
            noise = self._records.noise[self._order[name]]
            changed = adaptation.after(noise, correction, sensor.covariance)
            noise[...] = np.where(members & np.isfinite(changed), changed, noise)

    def _doubtful(self, disagreeing: Mask, correction: Correction) -> Mask:
        """Return the members whose belief may recover by a reading that does not agree."""
        if not disagreeing.any():
            return disagreeing
        total = self._records.rejections.sum(axis=0) + 1
        often = total >= (self._needed or np.inf)
        return np.asarray(disagreeing & often & np.isfinite(correction.nis))

    def whitened(self, error: Array) -> Array:
        """Return L^-1 error (..., n) with L L' = P, which is N(0, I) for consistent beliefs.

        The result is NaN where P is not positive definite.
        """
        P = self.belief.covariance
        if P.ndim == 2 and self.schedule.applies:
            try:
                return times(self.schedule.whitening(P), error)
            except np.linalg.LinAlgError:
                pass
        known, L = self._factored
        return whitened(L if known is P else self._filter.model.covariance_factor(P), error)

    def _predicted_as_scheduled(self, dt: float) -> Gaussian | None:
        """Return the beliefs after ``dt`` seconds if they share a covariance, else None."""
        x, P = self.belief
        if P.ndim != 2 or not self.schedule.applies:
            return None
        try:
            F, G, covariance = self.schedule.prediction(P, dt)
        except np.linalg.LinAlgError:
            return None
        mean = self.schedule.wrap(times(F, x) + times(G, self._input))
        return unchecked((mean, covariance)) if is_finite(mean) else None

    def _corrected_as_scheduled(self, name: str, y: Array) -> Correction | None:
        """Fuse readings if members share a covariance and there are no gates, else return None."""
        (x, P), sensor = self.belief, self._sensors[name]
        if P.ndim != 2 or not self.schedule.applies or self._weighs:
            return None
        try:
            scheduled = self.schedule.correction(P, sensor)
        except np.linalg.LinAlgError:
            return None
        if scheduled is None:
            return None
        innovation = sensor.output.subtract(y, sensor.measure(x))
        mean = self.schedule.wrap(x + times(scheduled.gain, innovation))
        if not (is_finite(innovation) and is_finite(mean)):
            return None
        self.belief = unchecked((mean, scheduled.covariance))
        self.fused[name] += 1
        S = scheduled.innovation_covariance
        nis = squared(times(scheduled.whitening, innovation))
        return Correction(self.belief, innovation, S, scheduled.gain, nis=nis)

    def _predicted(self, dt: float) -> Gaussian:
        """Return the beliefs after ``dt`` seconds; a member that fails restarts."""
        try:
            with np.errstate(all='ignore'):
                predicted = self._filter.predict(self.belief, self._input, dt)
                predicted, bad = self._committed(predicted, np.ones(self.members, dtype=bool))
        except (ArithmeticError, np.linalg.LinAlgError):
            predicted, bad = self.belief, np.ones(self.members, dtype=bool)
        if not bad.any():
            return predicted
        x, P = self._member_copies(predicted)
        for at in _indices(bad):
            u = np.broadcast_to(self._input, (*self.members, self._input.shape[-1]))[at]
            try:
                one = committed(self._one.predict(_member(self.belief, at), u, dt))[0]
            except np.linalg.LinAlgError:
                one = _member(self._initial, at)
            x[at], P[at] = one
        return unchecked((x, P))

    def _committed(self, belief: Gaussian, selected: Mask) -> tuple[Gaussian, Mask]:
        """Return repaired beliefs, and the mask of ``selected`` ones that cannot be repaired."""
        x, P = belief
        known = self._filter.model.covariance_factor(P) if belief.factor is None else belief.factor
        self._factored = P, known
        if is_finite(x) and is_finite(known):
            return belief, np.zeros_like(selected)
        definite = np.isfinite(known.diagonal(axis1=-2, axis2=-1)).all(axis=-1)
        bad = selected & ~(np.isfinite(np.einsum('...i,...i->...', x, x)) & definite)
        if not bad.any():
            return belief, bad
        x, P = self._member_copies(belief)
        failed = np.zeros_like(bad)
        for at in _indices(bad):
            try:
                x[at], P[at] = committed(Gaussian(x[at], P[at]))[0]
            except np.linalg.LinAlgError:
                failed[at] = True
        return unchecked((x, P)), failed

    def _member_copies(self, belief: Gaussian) -> tuple[Array, Array]:
        """Return copies of the means and covariances, one for each member."""
        x, P = belief
        return x.copy(order='K'), np.broadcast_to(P, (*self.members, *P.shape[-2:])).copy()

    def _gated(
        self,
        name: str,
        y: Array,
        correction: Correction,
        masks: tuple[Mask, ...],
        posterior: Gaussian,
    ) -> tuple[Gaussian, Mask]:
        """Record the outcomes at the gate; members that may recover pass the `Gate` of one run."""
        taken, agreed, passed, accepted, doubtful = masks
        assert self.time is not None
        order, sensor = self._order[name], self._sensors[name]
        fails = passed & ~accepted
        outside = taken & ~agreed & ~fails & np.isfinite(correction.nis)
        agrees = np.where(accepted & agreed, 1, np.where(outside, 0, NEVER))
        self._records.add(order, self.time, agrees, taken & ~doubtful)
        if not doubtful.any():
            return posterior, accepted
        x, P = self._member_copies(posterior)
        accepted = accepted.copy()
        for at in _indices(doubtful):
            before, accepted[at] = self._records.of(at), False
            try:
                result, one, after = self._gate.correct(
                    self._one, _member(self.belief, at), y[at], sensor, (self.time, order), before
                )
                accepted[at] = result.accepted
                if result.accepted:
                    x[at], P[at] = committed(one.posterior)[0]
            except np.linalg.LinAlgError:
                record = before[order].after(self.time, None)
                after = (*before[:order], record, *before[order + 1 :])
            self._records.set(at, after)
        return unchecked((x, P)), accepted


def _by_coordinate(x: Array) -> Array:
    """Return a copy of vectors (..., n) with the coordinate as the slowest axis in memory."""
    return np.moveaxis(np.moveaxis(x, -1, 0).copy(), 0, -1)


def _indices(mask: Mask) -> list[tuple[int, ...]]:
    return [tuple(at) for at in np.argwhere(mask).tolist()]


def _member(belief: Gaussian, at: tuple[int, ...]) -> Gaussian:
    """Return the belief of one member."""
    x, P = belief
    return Gaussian(x if x.ndim == 1 else x[at], P if P.ndim == 2 else P[at])
