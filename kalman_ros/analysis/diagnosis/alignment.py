# SPDX-License-Identifier: Apache-2.0
"""Readings of a sensor that is turned against the body: all its vectors and attitudes as one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array, rotations
from kalman_ros.core.quantity import ANGLES, ATTITUDE, PLACE, Quantity, quantities
from kalman_ros.scenario import SensorSource

Indices = npt.NDArray[np.intp]


def is_alignable(fields: Sequence[str]) -> bool:
    """Return whether fields have an attitude, or two vectors, that turn with the sensor."""
    turning = [group for group, _ in _turning(fields)]
    return len(turning) > 1 or any(group.kind == ATTITUDE for group in turning)


def aligned(fields: Sequence[str], values: Array, B: Array) -> Array:
    """Return readings (N, k) in the axes of the body.

    With the rotation B (3, 3) from the sensor's axes to the body's, a vector v becomes B v, and an
    attitude R becomes R B'. A place is one of the world, and stays.
    """
    result: Array = values.copy()
    for group, index in _turning(fields):
        known = np.ix_(np.flatnonzero(np.isfinite(values[:, index]).all(axis=1)), index)
        read, angles = values[known], group.names == ANGLES
        if group.kind != ATTITUDE:
            result[known] = read @ B.T
            continue
        r = rotations.from_euler(read) if angles else read
        turned = rotations.log(rotations.exp(r) @ B.T)
        result[known] = rotations.to_euler(turned) if angles else turned
    return result


def tilted(source: SensorSource, values: Array, size: float = 1e-4) -> Array:
    """Return what a turn about each axis adds to readings (N, k), in a radian (N, k, 3).

    The sensor is turned against the body by B = exp(turn), of a small ``size`` in rad.
    """
    fields, space = source.signal.fields, source.sensor.output
    return np.stack(
        [
            space.subtract(aligned(fields, values, rotations.exp(-size * axis)), values) / size
            for axis in np.eye(3)
        ],
        axis=-1,
    )


def _turning(fields: Sequence[str]) -> Iterator[tuple[Quantity, Indices]]:
    """Yield the quantities that turn with the sensor, with the indices of their three axes."""
    for group in quantities(tuple(fields)):
        if group.kind != PLACE and set(group.siblings()) <= set(fields):
            yield group, np.array([fields.index(field) for field in group.siblings()])
