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
from kalman_ros.core.mount import quaternion_matrix, roll_pitch_yaw, rotation_matrix
from kalman_ros.core.quantity import ATTITUDE, PLACE, Quantity, quantity

from .paths import parse, walk
from .signal_codec import SignalCodec


class TurnedCodec:
    """Reads vectors, places and attitudes in the axes of the body and the world, and writes them.

    With B the rotation from the sensor's axes to the body's and W that from the messages' world
    to east, north, up, a vector v is B v there, a place p is W p and an attitude R is W R B'. A
    covariance C of a vector becomes B C B'; that of an attitude is about fixed axes (REP-103):
    W C W'.

    It has the methods of a `SignalCodec`.

    Parameters
    ----------
    signal
        With its mounting.
    frame, child_frame
        Written to ``header.frame_id`` and ``child_frame_id``, if these fields exist.

    Raises
    ------
    ValueError
        If no field is one of three axes, or the covariance is only of some of them.
    """

    def __init__(self, signal: Signal, frame: str = '', child_frame: str = '') -> None:
        self.size = len(signal.fields)
        every = _complete(signal)
        if signal.covariance and len(every) > self.size:
            missing = ', '.join(every[self.size :])
            raise ValueError(
                f"signal '{signal.topic}': covariance: to be turned it must be of {missing}, too"
            )
        #: Reads and writes all axes as the sensor has them.
        self.inner = SignalCodec(replace(signal, fields=every), frame, child_frame)
        self.message_type, self.message = self.inner.message_type, self.inner.message
        self.carries_covariance = self.inner.carries_covariance
        self.has_covariance = self.inner.has_covariance
        mount = signal.mounting
        self._B, self._W = mount.body_from_sensor, mount.world_from_reported
        self._attitudes: list[tuple[Any, list[int]]] = []
        self._M = np.eye(len(every))
        for group in _groups(every):
            index = [every.index(field) for field in group.siblings()]
            turn = self._W if group.kind in (PLACE, ATTITUDE) else self._B
            self._M[np.ix_(index, index)] = turn
            if group.kind == ATTITUDE:
                way = parse(group.siblings()[0], self.message).parent
                self._attitudes.append((way, index))

    @property
    def linear(self) -> bool:
        """Whether `turn` is all that there is to do."""
        return not self._attitudes

    def turn(self, values: Array, covariance: Array | None) -> tuple[Array, Array | None]:
        """Return what `inner` reads in the axes of the body."""
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
        for way, index in self._attitudes:
            q = walk(message, way)
            R = self._W @ quaternion_matrix(q.x, q.y, q.z, q.w) @ self._B.T
            values[index] = roll_pitch_yaw(R)
        return values[: self.size]

    def decode_covariance(self, message: Any) -> Array | None:
        """Return the covariance (k, k) in a message; None if it has none for every field."""
        return self._turned(self.inner.decode_covariance(message))

    def encode(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message with these values (k,), stamped ``time`` in nanoseconds.

        An axis that is not among the fields is zero, with a variance of zero.
        """
        k, M = self.size, self._M
        full, C = np.zeros(len(M)), None
        full[:k] = values
        read = M.T @ full
        for _, index in self._attitudes:
            R = self._W.T @ rotation_matrix(*full[index].tolist()) @ self._B
            read[index] = roll_pitch_yaw(R)
        if covariance is not None:
            C = np.zeros(M.shape)
            C[:k, :k] = covariance
            C = M.T @ C @ M
        return self.inner.encode(time, read, C)


def _complete(signal: Signal) -> tuple[str, ...]:
    """Return the fields of a signal, and those that complete their axes."""
    groups = _groups(signal.fields)
    if not groups:
        listed = ', '.join(signal.fields)
        raise ValueError(
            f"signal '{signal.topic}': mount.rotation, convention: no axes to turn in {listed}"
        )
    every = [field for group in groups for field in group.siblings()]
    return tuple(dict.fromkeys((*signal.fields, *every)))


def _groups(fields: tuple[str, ...]) -> list[Quantity]:
    """Return what the fields read, each group of three axes once."""
    found = filter(None, map(quantity, fields))
    return list({(each.kind == ATTITUDE, each.owner): each for each in found}.values())
