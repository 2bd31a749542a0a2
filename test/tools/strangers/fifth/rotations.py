# SPDX-License-Identifier: Apache-2.0
"""Unit quaternions, with the real part first."""

from __future__ import annotations

import math
from collections.abc import Sequence

Quaternion = tuple[float, float, float, float]


def product(p: Sequence[float], q: Sequence[float]) -> Quaternion:
    """Return the product of two quaternions: the turn q, then the turn p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def exponential(r: Sequence[float]) -> Quaternion:
    """Return the quaternion of a rotation vector in rad."""
    angle = math.hypot(*r)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), share * r[0], share * r[1], share * r[2]


def logarithm(q: Sequence[float]) -> list[float]:
    """Return the rotation vector of a quaternion, of a length of at most pi."""
    sine = math.hypot(*q[1:])
    if sine < 1e-12:
        return [0.0, 0.0, 0.0]
    angle = 2.0 * math.atan2(math.copysign(sine, q[0]), abs(q[0]))
    return [angle / sine * part for part in q[1:]]


def rotated(q: Sequence[float], vector: Sequence[float]) -> list[float]:
    """Return a vector of the body in the axes of the world."""
    back = q[0], -q[1], -q[2], -q[3]
    return list(product(product(q, (0.0, *vector)), back)[1:])
