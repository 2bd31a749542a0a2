# SPDX-License-Identifier: Apache-2.0
"""Rotations in space as rotation vectors, and their group.

A rotation vector r (3,) has the direction of the axis and the length of the angle, in rad, at most
pi. R = Exp(r) turns vectors of the body's axes into the world's. Functions take any leading axes
and hold their precision at all angles, zero and pi included.

J. Sola, J. Deray and D. Atchuthan, A micro Lie theory for state estimation in robotics,
arXiv:1812.01537 (2018), of which the numbers of equations are.
"""

from __future__ import annotations

import numpy as np

from kalman_ros.linear.matrices import Array

#: Below this angle, quotients of differences are power series, exact to rounding.
_SMALL = 0.3
#: The mean of rotations is iterated until it moves by less than this, in rad.
_CLOSE, _MOST_STEPS = 1e-12, 50


def skew(r: Array) -> Array:
    """Return the matrix (..., 3, 3) of the cross product with ``r`` (..., 3)."""
    x, y, z = np.moveaxis(r, -1, 0)
    o = np.zeros_like(x)
    return _matrix([[o, -z, y], [z, o, -x], [-y, x, o]])


def exp(r: Array) -> Array:
    """Return the matrix R (..., 3, 3) of a rotation (..., 3): Rodrigues, equation 132."""
    K, angle = skew(r), _angle(r)[..., np.newaxis]
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + _second(angle) * (K @ K))


def log(R: Array) -> Array:
    """Return the rotation (..., 3) of a matrix (..., 3, 3), by its quaternion.

    The quaternion is that of the largest of its numbers, so that no difference cancels (S.
    Shepperd, Quaternion from Rotation Matrix, Journal of Guidance and Control 1(3), 1978).
    """
    t = R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2]
    x, y, z = (R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    diagonal = [1.0 - t + 2.0 * R[..., i, i] for i in range(3)]
    a, b, c = (R[..., i, j] + R[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    # each row is the quaternion times four of one of its numbers
    rows = _matrix(
        [
            [diagonal[0], a, b, x],
            [a, diagonal[1], c, y],
            [b, c, diagonal[2], z],
            [x, y, z, 1.0 + t],
        ]
    )
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, largest[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    return from_quaternion(q)


def compose(a: Array, b: Array) -> Array:
    """Return the rotation (..., 3) of first ``b``, then ``a``: Exp(a) Exp(b), by quaternions."""
    v, s = _quaternion(a)
    w, t = _quaternion(b)
    return _vector(s * w + t * v + np.cross(v, w), s * t - _dot(v, w))


def rotate(r: Array, v: Array) -> Array:
    """Return vectors of the body (..., 3) in the axes of the world, Exp(r) v."""
    return np.asarray((exp(r) @ v[..., np.newaxis])[..., 0])


def rotate_back(r: Array, v: Array) -> Array:
    """Return vectors of the world (..., 3) in the axes of the body, Exp(r)' v."""
    return rotate(-r, v)


def shortest(r: Array) -> Array:
    """Return the same rotations (..., 3) by angles of at most pi; those that are, unchanged."""
    angle = _angle(r)
    if not (angle > np.pi).any():
        return r
    turns = np.round(angle / (2.0 * np.pi))
    share = 2.0 * np.pi * turns / np.maximum(angle, np.pi)
    return np.asarray(np.where(angle > np.pi, r - share * r, r))


def left_jacobian(r: Array) -> Array:
    """Return J (..., 3, 3) for which Exp(r + d) = Exp(J d) Exp(r): equation 145."""
    K, angle = skew(r), _angle(r)[..., np.newaxis]
    return np.asarray(np.eye(3) + _second(angle) * K + _third(angle) * (K @ K))


def inverse_left_jacobian(r: Array) -> Array:
    """Return the inverse (..., 3, 3) of the left Jacobian, for angles below 2 pi: equation 146."""
    K, angle = skew(r), _angle(r)[..., np.newaxis]
    return np.asarray(np.eye(3) - 0.5 * K + _inverse_third(angle) * (K @ K))


def pulled_back(r: Array, rate: Array) -> Array:
    """Return the rate (..., 3) at which the vector of Exp(r) changes as it turns at ``rate``.

    The product of the inverse left Jacobian and the rate, in the axes of the world.
    """
    first = np.cross(r, rate)
    return np.asarray(rate - 0.5 * first + _inverse_third(_angle(r)) * np.cross(r, first))


def mean(points: Array, weights: Array) -> Array:
    """Return the weighted mean (..., 3) of rotations (k, ..., 3), from which their errors are 0.

    The sum of the errors Log(R_i R') is 0 (J. Manton, A globally convergent numerical algorithm
    for computing the centre of mass on compact Lie groups, ICARCV 2004).
    """
    found: Array = points[0]
    for _ in range(_MOST_STEPS):
        error = np.tensordot(weights, compose(points, -found), axes=1)
        found = compose(error, found)
        if not (np.abs(error) > _CLOSE).any():
            break
    return found


def from_quaternion(q: Array) -> Array:
    """Return the rotation (..., 3) of quaternions x, y, z, w (..., 4) of any length; 0 is NaN."""
    with np.errstate(invalid='ignore', divide='ignore'):
        unit = q / np.sqrt(_dot(q, q))
    return _vector(unit[..., :3], unit[..., 3:])


def to_quaternion(r: Array) -> Array:
    """Return the unit quaternions x, y, z, w (..., 4) of rotations (..., 3)."""
    return np.concatenate(_quaternion(r), axis=-1)


def from_euler(angles: Array) -> Array:
    """Return the rotation (..., 3) of roll, pitch and yaw (..., 3).

    They are about the fixed axes x, y and z, in this order (REP-103).
    """
    x, y, z = np.moveaxis(np.eye(3) * angles[..., np.newaxis], -2, 0)
    return compose(z, compose(y, x))


def to_euler(r: Array) -> Array:
    """Return roll, pitch and yaw (..., 3) of rotations (..., 3), as `from_euler` takes them."""
    R = exp(r)
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 2, 1], R[..., 2, 2]))
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return np.stack((roll, pitch, yaw), axis=-1)


def _matrix(rows: list[list[Array]]) -> Array:
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def _angle(r: Array) -> Array:
    """Return the angles (..., 1)."""
    return np.sqrt(_dot(r, r))


def _quaternion(r: Array) -> tuple[Array, Array]:
    """Return the vector (..., 3) and the scalar (..., 1) of the unit quaternion."""
    half = 0.5 * _angle(r)
    return 0.5 * np.sinc(half / np.pi) * r, np.cos(half)


def _vector(v: Array, w: Array) -> Array:
    """Return the rotation (..., 3) of a unit quaternion with vector ``v`` and scalar ``w``."""
    v, w = np.where(w < 0.0, -v, v), np.abs(w)
    n = _angle(v)
    # 2 atan2(n, w) / n, which is 2 / w at 0
    ratio = np.divide(np.arctan2(n, w), n, out=np.ones_like(n), where=n > 0.0)
    return np.asarray(2.0 * ratio * v)


def _second(angle: Array) -> Array:
    """Return (1 - cos a) / a^2."""
    return np.asarray(0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2)


def _third(angle: Array) -> Array:
    """Return (a - sin a) / a^3."""
    a = np.maximum(angle, _SMALL)
    s = angle**2
    series = 1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))
    return np.where(angle < _SMALL, series / 6.0, (a - np.sin(a)) / a**3)


def _inverse_third(angle: Array) -> Array:
    """Return (1 - a / 2 cot(a / 2)) / a^2."""
    a = np.maximum(angle, _SMALL)
    s = angle**2
    series = 1.0 + s / 60.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0 * (1.0 + s * 10.0 / 396.0)))
    return np.where(angle < _SMALL, series / 12.0, (1.0 - 0.5 * a / np.tan(0.5 * a)) / a**2)
