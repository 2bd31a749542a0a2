# SPDX-License-Identifier: Apache-2.0
"""Rotations in space as rotation vectors, and their group.

A rotation vector r (3,) has the direction of the axis and the length of the angle, in rad, at most
pi. R = Exp(r) turns vectors of the body's axes into the world's. Functions take any leading axes
and hold their precision at all angles, zero and pi included.

Equation numbers refer to J. Sola, J. Deray and D. Atchuthan, A micro Lie theory for state
estimation in robotics, arXiv:1812.01537 (2018).
"""

from __future__ import annotations

from math import atan2, cos, inf, nan, pi, sin, sqrt, tan
from typing import Any

import numpy as np

from kalman_ros.linear.matrices import Array
from kalman_ros.linear.views import coordinates, from_coordinates

#: A number, or an array (...,) of numbers: a single rotation is computed in plain floats, which
#: takes a tenth of the time.
_Number = Any
#: Angle below which quotients of differences are power series, exact to rounding.
_SMALL = 0.3
#: Change in rad below which the iteration of the mean of rotations ends, and most iterations.
_CLOSE, _MOST_STEPS = 1e-12, 50


def skew(r: Array) -> Array:
    """Return the matrix (..., 3, 3) of the cross product with ``r`` (..., 3)."""
    x, y, z = _parts(r)
    o = 0.0 * x
    return _matrix([[o, -z, y], [z, o, -x], [-y, x, o]])


def exp(r: Array) -> Array:
    """Return the matrix R (..., 3, 3) of a rotation (..., 3): Rodrigues, equation 132."""
    angle = _angle(*_parts(r))
    sine, cosine = _half(angle)
    return _series(r, 2.0 * sine * cosine, 2.0 * sine * sine)


def log(R: Array) -> Array:
    """Return the rotation (..., 3) of a matrix (..., 3, 3), by its quaternion.

    The quaternion is computed from the largest of its numbers, so that no difference cancels (S.
    Shepperd, Quaternion from Rotation Matrix, Journal of Guidance and Control 1(3), 1978).
    """
    t = R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2]
    x, y, z = (R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    d, e, f = (1.0 - t + 2.0 * R[..., i, i] for i in range(3))
    a, b, c = (R[..., i, j] + R[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    # each row is the quaternion times four of one of its numbers
    rows = _matrix([[d, a, b, x], [a, e, c, y], [b, c, f, z], [x, y, z, 1.0 + t]])
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, largest[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    return from_quaternion(q)


def compose(a: Array, b: Array) -> Array:
    """Return the rotation (..., 3) of first ``b``, then ``a``: Exp(a) Exp(b), by quaternions."""
    (*v, s), (*w, t) = _quaternion(*_parts(a)), _quaternion(*_parts(b))
    x, y, z = (s * p + t * q + r for p, q, r in zip(w, v, _cross(v, w)))
    return _rotation(x, y, z, s * t - v[0] * w[0] - v[1] * w[1] - v[2] * w[2])


def rotate(r: Array, v: Array) -> Array:
    """Return vectors of the body (..., 3) in the axes of the world, Exp(r) v."""
    return np.asanyarray((exp(r) @ v[..., np.newaxis])[..., 0])


def rotate_back(r: Array, v: Array) -> Array:
    """Return vectors of the world (..., 3) in the axes of the body, Exp(r)' v."""
    return rotate(-r, v)


def shortest(r: Array) -> Array:
    """Return the same rotations (..., 3) with angles of at most pi, unchanged if they are."""
    angle = np.asanyarray(_angle(*_parts(r)))[..., np.newaxis]
    beyond = angle > pi
    if beyond.dtype == bool and not beyond.any():
        return r
    share = 2.0 * pi * np.round(angle / (2.0 * pi)) / np.maximum(angle, pi)
    return np.asanyarray(np.where(beyond, r - share * r, r))


def left_jacobian(r: Array) -> Array:
    """Return J (..., 3, 3) for which Exp(r + d) = Exp(J d) Exp(r): equation 145."""
    angle = _angle(*_parts(r))
    sine, _ = _half(angle)
    return _series(r, 2.0 * sine * sine, _third(angle))


def inverse_left_jacobian(r: Array) -> Array:
    """Return the inverse (..., 3, 3) of the left Jacobian, for angles below 2 pi: equation 146."""
    return _series(r, -0.5, _inverse_third(_angle(*_parts(r))))


def pulled_back(r: Array, rate: Array) -> Array:
    """Return the rate (..., 3) at which the vector of Exp(r) changes as it turns at ``rate``.

    It is the product of the inverse left Jacobian and the rate, in the axes of the world.
    """
    turn, w = _parts(r), _parts(rate)
    once, share = _cross(turn, w), _inverse_third(_angle(*turn))
    twice = _cross(turn, once)
    return from_coordinates(*(p - 0.5 * q + share * s for p, q, s in zip(w, once, twice)))


def cross(a: Array, b: Array) -> Array:
    """Return the cross product (..., 3), faster than numpy does."""
    return from_coordinates(*_cross(_parts(a), _parts(b)))


def mean(points: Array, weights: Array) -> Array:
    """Return the weighted mean (..., 3) of rotations (k, ..., 3), whose mean error about it is 0.

    The sum of the errors Log(R_i R') is 0 (J. Manton, A globally convergent numerical algorithm
    for computing the centre of mass on compact Lie groups, ICARCV 2004).
    """
    centre: Array = points[0]
    for _ in range(_MOST_STEPS):
        error = np.tensordot(weights, compose(points, -centre), axes=1)
        centre = compose(error, centre)
        if not (np.abs(error) > _CLOSE).any():
            break
    return centre


def from_quaternion(q: Array) -> Array:
    """Return the rotation (..., 3) of quaternions x, y, z, w (..., 4) of any length; 0 is NaN."""
    length = np.sqrt((q * q).sum(axis=-1))
    with np.errstate(invalid='ignore', divide='ignore'):
        return _rotation(*np.moveaxis(q, -1, 0) / length)


def to_quaternion(r: Array) -> Array:
    """Return the unit quaternions x, y, z, w (..., 4) of rotations (..., 3)."""
    return from_coordinates(*_quaternion(*_parts(r)))


def from_euler(angles: Array) -> Array:
    """Return the rotation (..., 3) of roll, pitch and yaw (..., 3).

    The angles are about the fixed axes x, y and z, in this order (REP-103).
    """
    x, y, z = np.moveaxis(np.eye(3) * angles[..., np.newaxis], -2, 0)
    return compose(z, compose(y, x))


def to_euler(r: Array) -> Array:
    """Return roll, pitch and yaw (..., 3) of rotations (..., 3), as `from_euler` takes them.

    Near a pitch of +-pi/2 only their sum or difference is determined: the roll is therefore that
    which belongs to the yaw, by the second row of Rz(-yaw) R = Ry(pitch) Rx(roll).
    """
    R = exp(r)
    level = np.sqrt(R[..., 2, 1] ** 2 + R[..., 2, 2] ** 2)
    pitch = np.arctan2(-R[..., 2, 0], level)
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    sine, cosine = s * R[..., 0, 2] - c * R[..., 1, 2], c * R[..., 1, 1] - s * R[..., 0, 1]
    roll = np.arctan2(sine, cosine)
    return np.stack((roll, pitch, yaw), axis=-1)


def _parts(r: Array) -> tuple[_Number, _Number, _Number]:
    """Return the coordinates, as floats for a single vector."""
    x, y, z = r.tolist() if r.ndim == 1 else coordinates(r)
    return x, y, z


def _matrix(rows: list[list[_Number]]) -> Array:
    whole: Array = np.array(rows)
    return whole if whole.ndim == 2 else np.moveaxis(whole, (0, 1), (-2, -1))


def _cross(a: Any, b: Any) -> tuple[_Number, _Number, _Number]:
    (p, q, r), (x, y, z) = a, b
    return q * z - r * y, r * x - p * z, p * y - q * x


def _series(r: Array, first: _Number, second: _Number) -> Array:
    """Return 1 + first [r]x + second [r]x^2 (..., 3, 3)."""
    x, y, z = _parts(r)
    a, b, c = first * x, first * y, first * z
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    return _matrix(
        [
            [1.0 - yy - zz, xy - c, xz + b],
            [xy + c, 1.0 - xx - zz, yz - a],
            [xz - b, yz + a, 1.0 - xx - yy],
        ]
    )


def _angle(x: _Number, y: _Number, z: _Number) -> _Number:
    square = x * x + y * y + z * z
    if isinstance(square, float):
        return sqrt(square) if square < inf else nan
    return np.sqrt(square)


def _half(angle: _Number) -> tuple[_Number, _Number]:
    """Return sin(a / 2) / a and cos(a / 2)."""
    if isinstance(angle, float):
        return (sin(0.5 * angle) / angle if angle else 0.5), cos(0.5 * angle)
    return 0.5 * np.sinc(angle / (2.0 * pi)), np.cos(0.5 * angle)


def _quaternion(x: _Number, y: _Number, z: _Number) -> tuple[_Number, ...]:
    """Return the unit quaternion x, y, z, w of a rotation vector."""
    share, w = _half(_angle(x, y, z))
    return share * x, share * y, share * z, w


def _rotation(x: _Number, y: _Number, z: _Number, w: _Number) -> Array:
    """Return the rotation (..., 3) of a unit quaternion."""
    n = _angle(x, y, z)
    if isinstance(n, float):
        share = 2.0 * atan2(n, abs(w)) / n if n else 2.0
        share = -share if w < 0.0 else share
    else:
        half = np.arctan2(n, np.abs(w))
        share = 2.0 * np.divide(half, n, out=np.ones_like(half), where=n != 0.0)
        share = np.where(w < 0.0, -share, share)
    return from_coordinates(share * x, share * y, share * z)


def _third(angle: _Number) -> _Number:
    """Return (a - sin a) / a^3."""
    s = angle * angle
    series = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    if isinstance(angle, float):
        return series if angle < _SMALL else (angle - sin(angle)) / (s * angle)
    a = np.maximum(angle, _SMALL)
    return np.where(angle < _SMALL, series, (a - np.sin(a)) / a**3)


def _inverse_third(angle: _Number) -> _Number:
    """Return (1 - a / 2 cot(a / 2)) / a^2."""
    s = angle * angle
    series = (1.0 + s / 60.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0 * (1.0 + s / 39.6)))) / 12.0
    if isinstance(angle, float):
        return series if angle < _SMALL else (1.0 - 0.5 * angle / tan(0.5 * angle)) / s
    a = np.maximum(angle, _SMALL)
    return np.where(angle < _SMALL, series, (1.0 - 0.5 * a / np.tan(0.5 * a)) / a**2)
