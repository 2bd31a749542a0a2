# SPDX-License-Identifier: Apache-2.0
"""Fixes of a satellite receiver, ``sensor_msgs/NavSatFix``, as metres of a datum.

Like the angles of a quaternion, ``east``, ``north`` and ``up`` are fields of such a message that
are computed from its own fields.
"""

from __future__ import annotations

from math import isnan
from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal
from kalman_ros.core.geodesy import Origin, Place, place

from .messages import full_type, message_type, write_stamp

TYPE = 'sensor_msgs/NavSatFix'
#: Computed fields.
LOCAL = ('east', 'north', 'up')


class NoFixError(ValueError):
    """Error of a message without a position."""


def is_local(signal: Signal) -> bool:
    """Return whether a signal has a computed field of a fix.

    Raises
    ------
    ValueError
        If it mixes computed fields with others, or repeats one.
    """
    fields = signal.fields
    if full_type(signal.type) != full_type(TYPE) or not {*fields}.intersection(LOCAL):
        return False
    if {*fields} - {*LOCAL} or len({*fields}) < len(fields) or signal.covariance:
        expected = f'expected {", ".join(LOCAL)}, each at most once, and no covariance path'
        raise ValueError(f"signal '{signal.topic}': fields: {expected}, got {', '.join(fields)}")
    return True


class FixCodec:
    """Codec of metres east, north and up of a datum, read from fixes and written as fixes.

    It has the methods of a `SignalCodec`.

    Parameters
    ----------
    signal
        Topic, type, fields, and the datum if it is known.
    frame
        Frame that is written to ``header.frame_id``.
    origin
        Datum of several receivers, which the first fix that is read may set.
    """

    carries_covariance = has_covariance = True

    def __init__(self, signal: Signal, frame: str = '', origin: Origin | None = None) -> None:
        self.message_type = message_type(signal.type)
        self.message = self.message_type()
        self.message.header.frame_id = frame
        status = self.message.status
        status.status, status.service = status.STATUS_FIX, status.SERVICE_GPS
        self.size = len(signal.fields)
        self._origin = Origin(signal.datum) if origin is None else origin
        self._rows = [LOCAL.index(field) for field in signal.fields]
        self._block = np.ix_(self._rows, self._rows)

    def decode(self, message: Any) -> Array:
        """Return the vector (k,) in a message; NaN for a height that the message lacks.

        Raises
        ------
        NoFixError
            If the message has no position.
        """
        where = place_of(message)
        plane = self._origin.at(where)
        if isnan(where.altitude):
            local = plane.local(where._replace(altitude=plane.datum.altitude))
            local[2] = np.nan
        else:
            local = plane.local(where)
        return local[self._rows]

    def decode_covariance(self, message: Any) -> Array | None:
        """Return the covariance (k, k) of a message; None if its type is unknown.

        It is given in the directions at the receiver, and returned in the directions at the datum.
        """
        kind, known = message.position_covariance_type, self.message_type
        if kind not in (
            known.COVARIANCE_TYPE_APPROXIMATED,
            known.COVARIANCE_TYPE_DIAGONAL_KNOWN,
            known.COVARIANCE_TYPE_KNOWN,
        ):
            return None
        C = np.array(message.position_covariance, dtype=float).reshape(3, 3)
        if kind == known.COVARIANCE_TYPE_DIAGONAL_KNOWN:
            C = np.diag(C.diagonal())
        if np.isfinite(C).all():
            where = place_of(message)
            T = self._origin.at(where).turn(where)
            C = T @ C @ T.T
            C = 0.5 * (C + C.T)
        return C[self._block]

    def encode(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the fix at these values (k,), stamped ``time`` in nanoseconds.

        A direction that is not among the fields is zero, with a variance of zero.

        Raises
        ------
        ValueError
            If the datum is unknown.
        """
        plane, message = self._origin.plane, self.message
        if plane is None:
            raise ValueError('datum: expected latitude, longitude and altitude to write a fix')
        local = np.zeros(3)
        local[self._rows] = values
        where = plane.place(local)
        write_stamp(message.header.stamp, time)
        message.latitude, message.longitude, message.altitude = where
        if covariance is not None:
            C = np.zeros((3, 3))
            C[self._block] = covariance
            T = plane.turn(where)
            np.frombuffer(message.position_covariance)[:] = (T.T @ C @ T).ravel()
            message.position_covariance_type = message.COVARIANCE_TYPE_KNOWN
        return message


def place_of(message: Any) -> Place:
    """Return the place in a fix, with the height NaN if it has none.

    Raises
    ------
    NoFixError
        If its status is not a fix, or the numbers are not a place.
    """
    status = message.status.status
    if status < message.status.STATUS_FIX:
        raise NoFixError(f'status: expected at least {message.status.STATUS_FIX}, got {status}')
    latitude, longitude, altitude = message.latitude, message.longitude, message.altitude
    if latitude == longitude == 0.0:
        raise NoFixError('latitude and longitude are both exactly 0, as before the first fix')
    try:
        where = place('fix', (latitude, longitude, 0.0 if isnan(altitude) else altitude))
    except ValueError as error:
        raise NoFixError(str(error)) from None
    return where._replace(altitude=altitude)
