# SPDX-License-Identifier: Apache-2.0
"""The covariances in standard messages, and the fields of their rows."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array

from .paths import ANGLES, VECTOR, Path, Way, walk

_XYZ = ('x', 'y', 'z')


def _below(part: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f'{part}.{name}' for name in names)


#: Covariances of each message type: the attribute, and the field of each row.
_COVARIANCES: dict[str, dict[str, tuple[str, ...]]] = {
    'PoseWithCovariance': {
        'covariance': _below('pose.position', _XYZ) + _below('pose.orientation', ANGLES)
    },
    'TwistWithCovariance': {
        'covariance': _below('twist.linear', _XYZ) + _below('twist.angular', _XYZ)
    },
    'AccelWithCovariance': {
        'covariance': _below('accel.linear', _XYZ) + _below('accel.angular', _XYZ)
    },
    'Imu': {
        'orientation_covariance': _below('orientation', ANGLES),
        'angular_velocity_covariance': _below('angular_velocity', _XYZ),
        'linear_acceleration_covariance': _below('linear_acceleration', _XYZ),
    },
    'MagneticField': {'magnetic_field_covariance': _below('magnetic_field', _XYZ)},
    'FluidPressure': {'variance': ('fluid_pressure',)},
    'Temperature': {'variance': ('temperature',)},
    'RelativeHumidity': {'variance': ('relative_humidity',)},
    'Illuminance': {'variance': ('illuminance',)},
}


#: The numbers of a rotation vector are in the rows of roll, pitch and yaw: these are turns about
#: fixed axes (geometry_msgs/PoseWithCovariance), as are the errors of a rotation.
_ROWS = dict(zip(VECTOR, ANGLES))

#: First element of a covariance of a message whose driver has no such reading, by the comments of
#: sensor_msgs/Imu.
ABSENT = -1.0
#: Types with this convention.
_DECLARING = ('Imu',)


class AbsentError(ValueError):
    """Error of a message that declares a field as absent."""


def declaring(paths: Sequence[Path], sample: Any) -> list[Way]:
    """Return the covariances whose first element may declare a field of ``paths`` as absent."""
    ways = dict.fromkeys(
        place[0]
        for place in (_covariance_row(path, sample) for path in paths)
        if place is not None and type(walk(sample, place[0][:-1])).__name__ in _DECLARING
    )
    return list(ways)


def refuse_absent(ways: Sequence[Way], first: Sequence[float]) -> None:
    """Raise AbsentError if the ``first`` element of a covariance of ``ways`` declares absence."""
    for way, value in zip(ways, first):
        if value == ABSENT:
            raise AbsentError(f'{way[-1]}[0] is {ABSENT:g}')


@dataclass(frozen=True)
class Block:
    """A covariance array in a message, and the coordinates of its rows.

    ``own`` are indices into the vector, ``rows`` into the array; ``size`` is the array's width.
    """

    way: Way
    own: tuple[int, ...]
    rows: tuple[int, ...]
    size: int

    def values(self, message: Any) -> Array:
        """Return the numbers of the array (size * size,) in a message.

        Raises
        ------
        ValueError
            If there are more or fewer numbers.
        """
        numbers = np.asarray(walk(message, self.way), dtype=float).ravel()
        if numbers.size != self.size**2:
            way = '.'.join(map(str, self.way))
            raise ValueError(f'{way}: expected {self.size**2} numbers, got {numbers.size}')
        return numbers


def flat_indices(chosen: Sequence[int], size: int) -> npt.NDArray[np.intp]:
    """Return the flat indices of the block of the ``chosen`` rows in a (size, size) matrix."""
    index = np.asarray(chosen, dtype=np.intp)
    return (index[:, np.newaxis] * size + index).ravel()


def blocks(paths: Sequence[Path], sample: Any, explicit: str = '') -> tuple[Block, ...]:
    """Return the covariance blocks of the fields ``paths`` of messages like ``sample``.

    ``explicit`` is the path of an array that holds the covariance of exactly these fields.

    Raises
    ------
    ValueError
        If that is not the path of an array of the right size, or of a number for a single field.
    """
    if explicit:
        everything = tuple(range(len(paths)))
        way: Way = tuple(explicit.split('.'))
        if not _has_room(sample, way, len(paths)):
            kind, count = type(sample).__name__, len(paths) ** 2
            raise ValueError(
                f"covariance: expected the path of {count} numbers in {kind}, got '{explicit}'"
            )
        return (Block(way, everything, everything, len(paths)),)
    rows_by_way: dict[Way, list[tuple[int, int, int]]] = {}
    for index, path in enumerate(paths):
        place = _covariance_row(path, sample)
        if place is not None:
            way, row, size = place
            rows_by_way.setdefault(way, []).append((index, row, size))
    return tuple(
        Block(way, tuple(i for i, _, _ in rows), tuple(row for _, row, _ in rows), rows[0][2])
        for way, rows in rows_by_way.items()
    )


def _has_room(sample: Any, way: Way, size: int) -> bool:
    """Return whether a covariance of ``size`` rows fits at the end of ``way``."""
    try:
        value = walk(sample, way)
    except AttributeError:
        return False
    if isinstance(value, np.ndarray):  # a fixed-length array
        return bool(value.dtype == float and value.size == size**2)
    if isinstance(value, array):
        return value.typecode == 'd'
    return isinstance(value, float) and size == 1


def _covariance_row(path: Path, sample: Any) -> tuple[Way, int, int] | None:
    """Return the covariance array with a row for ``path``, the row, and the array's width."""
    for depth in range(len(path.way)):
        owner = walk(sample, path.way[:depth])
        rest = '.'.join(map(str, (*path.way[depth:-1], _ROWS.get(path.attribute, path.attribute))))
        for attribute, rows in _COVARIANCES.get(type(owner).__name__, {}).items():
            if rest in rows:
                return (*path.way[:depth], attribute), rows.index(rest), len(rows)
    return None
