# SPDX-License-Identifier: Apache-2.0
"""Poses as changes: from one pose to the next, as a velocity, or from the first pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Array, Signal
from kalman_ros.core import rotations as so3
from kalman_ros.core.quantity import ANGLES, ATTITUDE, GLOBAL, PLACE, ROTATION, Quantity, quantity
from kalman_ros.linear.single import is_definite

#: Nanoseconds between two poses beyond which their change is not a velocity.
_APART = 1_000_000_000
_AXES = 'xyz'


class FirstPoseError(ValueError):
    """There is no earlier pose that this one could be compared with."""


def whole_pose(signal: Signal) -> Signal:
    """Return the signal of the whole pose, or of the whole orientation, whose fields are read.

    Raises
    ------
    ValueError
        If a field is of neither a position nor an orientation.
    """
    quantities = [quantity(field) for field in signal.fields]
    if not all(
        item is not None and item.kind in (PLACE, ATTITUDE) and item.names != GLOBAL
        for item in quantities
    ):
        listed = ', '.join(signal.fields)
        expected = 'expected fields of a position or orientation'
        raise ValueError(f"signal '{signal.topic}': pose: {expected}, got {listed}")
    if any(item.kind == PLACE for item in quantities if item is not None):
        owner = next(item.owner for item in quantities if item is not None).rpartition('.')[0]
        start = f'{owner}.' if owner else ''
        fields = [f'{start}position.{axis}' for axis in _AXES]
        fields += [f'{start}orientation.{name}' for name in ROTATION]
    else:
        owner = quantities[0].owner if quantities[0] is not None else ''
        fields = [f'{owner}.{name}' for name in ROTATION]
    return replace(signal, fields=tuple(fields))


class PoseChange:
    """Change between poses, seen from the axes of the body at the earlier pose.

    With poses (p_0, R_0) and (p_1, R_1) the change is d = R_0' (p_1 - p_0) and Log(R_0' R_1). As a
    velocity, it is divided by the time between, and d is turned by half of the rotation, into the
    axes of the body on the way (J. Sola et al., A micro Lie theory, 2021, section II). A reading
    of the velocity holds at the later stamp.

    The covariance is that of a difference. If the covariances of the poses grow, as those of an
    odometry that integrates do, it is their growth C_1 - C_0. Otherwise the errors are taken as
    independent, and it is C_1 + C_0, for d with the effect of errors of the rotation on p_1 - p_0.

    Parameters
    ----------
    signal
        Signal of the sensor; its ``pose`` is ``differential`` or ``relative``.
    """

    def __init__(self, signal: Signal) -> None:
        self._differential = signal.pose == 'differential'
        self._whole = len(whole_pose(signal).fields) == 6
        self._quantities: list[Quantity] = [
            item for item in map(quantity, signal.fields) if item is not None
        ]
        self._earlier: Sample | None = None

    def __call__(self, sample: Sample) -> Sample:
        """Return the change up to a pose.

        Raises
        ------
        FirstPoseError
            If the pose is the first, or too long after the last one.
        """
        earlier, time = self._earlier, sample.time or 0
        passed = 0 if earlier is None else time - (earlier.time or 0)
        if not np.isfinite(sample.values).all():
            return Sample(sample.time, np.full(len(self._quantities), np.nan), None)
        usable = earlier is not None and (not self._differential or 0 < passed <= _APART)
        if (self._differential or earlier is None) and (passed > 0 or not usable):
            self._earlier = sample
        if earlier is None or not usable:
            raise FirstPoseError('the first pose, or none before it within 1 s')
        return self._change(earlier, sample, passed * 1e-9 if self._differential else 0.0)

    def _change(self, earlier: Sample, later: Sample, dt: float) -> Sample:
        """Return the change, as a velocity if ``dt`` is not 0."""
        (p_0, r_0), (p_1, r_1) = self._parts(earlier.values), self._parts(later.values)
        turn = so3.compose(-r_0, r_1)
        step = so3.rotate_back(r_0, p_1 - p_0)
        # into the axes of the body at the earlier pose, or on the way
        T = so3.exp(-r_0)
        if dt:
            half = so3.exp(-0.5 * turn)
            step, turn, T = half @ step / dt, turn / dt, half @ T
        C = self._covariance(earlier, later, p_1 - p_0, T)
        if C is not None and dt:
            C = C / dt**2
        angles = turn if dt else so3.to_euler(turn)
        values, rows = [], []
        for kind, axis, _, names in self._quantities:
            source = step if kind == PLACE else angles if names == ANGLES else turn
            values.append(source[axis])
            rows.append(axis if kind == PLACE or not self._whole else 3 + axis)
        block = np.ix_(rows, rows)
        return Sample(later.time, np.array(values), None if C is None else C[block])

    def _parts(self, values: Array) -> tuple[Array, Array]:
        return (values[:3], values[3:]) if self._whole else (np.zeros(3), values)

    def _covariance(self, earlier: Sample, later: Sample, moved: Array, T: Array) -> Array | None:
        C_0, C_1 = earlier.covariance, later.covariance
        if C_0 is None or C_1 is None:
            return None
        C = C_1 - C_0
        if not is_definite(C):
            # errors are about the axes of the world; the error of the first rotation turns the way
            # between, or the mean of both errors does
            A_0, A_1 = -np.eye(len(C)), np.eye(len(C))
            if self._whole:
                J = so3.skew(moved)
                A_0[:3, 3:], A_1[:3, 3:] = (0.5 * J, 0.5 * J) if self._differential else (J, 0 * J)
            C = A_1 @ C_1 @ A_1.T + A_0 @ C_0 @ A_0.T
        G = np.kron(np.eye(2), T) if self._whole else T
        C = G @ C @ G.T
        return np.asarray(0.5 * (C + C.T))
