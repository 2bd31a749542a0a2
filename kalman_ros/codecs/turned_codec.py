# SPDX-License-Identifier: Apache-2.0
"""Readings of a sensor that is turned against its body, in the axes of the body.

A field then means the body's axis: ``angular_velocity.z`` is computed from all three axes of a
tilted gyroscope, and so is its variance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.core import rotations as so3
from kalman_ros.core.quantity import ANGLES, ATTITUDE, PLACE, quantities

from .paths import parse, walk
from .signal_codec import SignalCodec


class TurnedCodec:
    """Codec of vectors, places and attitudes in the axes of the body and the world.

    B is the rotation from the sensor's axes to the body's, and W the rotation from the messages'
    world to east, north, up. There a vector v is B v, a place p is W p, and an attitude R is
    W R B'. A covariance C of a vector becomes B C B'; the covariance of an attitude is about
    fixed axes (REP-103), and becomes W C W'.

    It has the methods of a `SignalCodec`.

    Parameters
    ----------
    signal
        Signal with its mounting.
    frame, child_frame
        Frames for ``header.frame_id`` and ``child_frame_id``, if these fields exist.

    Raises
    ------
    ValueError
        If no field is one of three axes, or the covariance covers only some of them.
    """

    def __init__(self, signal: Signal, frame: str = '', child_frame: str = '') -> None:
        self.size = len(signal.fields)
        fields = _complete(signal)
        if signal.covariance and len(fields) > self.size:
            missing = ', '.join(fields[self.size :])
            raise ValueError(
                f"signal '{signal.topic}': covariance: to be turned it must be of {missing}, too"
            )
        #: Codec of all axes as the sensor has them.
        self.inner = SignalCodec(replace(signal, fields=fields), frame, child_frame)
        self.message_type, self.message = self.inner.message_type, self.inner.message
        self.carries_covariance = self.inner.carries_covariance
        self.has_covariance = self.inner.has_covariance
        mount = signal.mounting
        self._B, self._W = mount.body_from_sensor, mount.world_from_reported
        #: Way of each quaternion, whether it is read as angles, and the indices of its numbers.
        self._attitudes: list[tuple[Any, bool, list[int]]] = []
        self._M = np.eye(len(fields))
        for group in quantities(fields):
            index = [fields.index(field) for field in group.siblings()]
            turn = self._W if group.kind in (PLACE, ATTITUDE) else self._B
            self._M[np.ix_(index, index)] = turn
            if group.kind == ATTITUDE:
                way = parse(group.siblings()[0], self.message).parent
                self._attitudes.append((way, group.names == ANGLES, index))

    @property
    def linear(self) -> bool:
        """Whether `turn` alone converts a message."""
        return not self._attitudes

    def turn(self, values: Array, covariance: Array | None) -> tuple[Array, Array | None]:
        """Return the vector and covariance that `inner` reads, in the axes of the body."""
        return (self._M @ values)[: self.size], self._turned(covariance)

    def _turned(self, covariance: Array | None) -> Array | None:
        if covariance is None:
            return None
        k, M = self.size, self._M
        C = (M @ covariance @ M.T)[:k, :k]
        return np.asarray(0.5 * (C + C.T))

    def decode(self, message: Any) -> Array:
        """Return the vector (k,) in a message."""
        values = self._M @ self.inner.decode(message)
        for way, as_angles, index in self._attitudes:
            q = walk(message, way)
            read = so3.exp(so3.from_quaternion(np.array((q.x, q.y, q.z, q.w))))
            r = so3.log(self._W @ read @ self._B.T)
            values[index] = so3.to_euler(r) if as_angles else r
        return values[: self.size]

    def decode_covariance(self, message: Any) -> Array | None:
        """Return the covariance (k, k) in a message; None if it does not cover every field."""
        return self._turned(self.inner.decode_covariance(message))

    def encode(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message with these values (k,), stamped ``time`` in nanoseconds.

        An axis that is not among the fields is zero, with a variance of zero.
        """
        k, M = self.size, self._M
        full, C = np.zeros(len(M)), None
        full[:k] = values
        if covariance is not None:
            C = np.zeros(M.shape)
            C[:k, :k] = covariance
            C = M.T @ C @ M
        message = self.inner.encode(time, M.T @ full, C)
        for way, as_angles, index in self._attitudes:
            r = so3.from_euler(full[index]) if as_angles else full[index]
            q, turned = walk(message, way), so3.log(self._W.T @ so3.exp(r) @ self._B)
            q.x, q.y, q.z, q.w = so3.to_quaternion(turned).tolist()
        return message


def _complete(signal: Signal) -> tuple[str, ...]:
    """Return the fields of a signal, and those that complete their axes."""
    groups = quantities(signal.fields)
    if not groups:
        listed = ', '.join(signal.fields)
        raise ValueError(
            f"signal '{signal.topic}': mount.rotation, mount.heading, convention: no axes to "
            f'turn in {listed}'
        )
    siblings = [field for group in groups for field in group.siblings()]
    return tuple(dict.fromkeys((*signal.fields, *siblings)))
