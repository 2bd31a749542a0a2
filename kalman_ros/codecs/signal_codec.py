# SPDX-License-Identifier: Apache-2.0
"""The mapping of a model's vector to fields of a message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kalman_ros.core import Array, Signal

from .covariances import AbsentError, Block, blocks, declaring, flat_indices, refuse_absent
from .messages import message_type, write_stamp
from .numbers import converter
from .paths import (
    ANGLES,
    VECTOR,
    Path,
    Way,
    is_quaternion,
    parse,
    reader,
    size_arrays,
    walk,
    write_euler,
    write_vector,
)

#: A type whose definition asks for ranges outside of its limits to be discarded.
_RANGE = 'sensor_msgs/Range'


class SignalCodec:
    """Codec of a vector, and of its covariance, in messages.

    `encode` always returns the same message object: publish it at once.

    Parameters
    ----------
    signal
        Topic, type and fields.
    frame, child_frame
        Frames for ``header.frame_id`` and ``child_frame_id``, if these fields exist.

    Raises
    ------
    ValueError
        If the type is not installed or lacks a field; the error names the topic.
    """

    def __init__(self, signal: Signal, frame: str = '', child_frame: str = '') -> None:
        try:
            self.message_type = message_type(signal.type)
            self.message = self.message_type()
            self._paths = [parse(field, self.message) for field in signal.fields]
            _check_quaternions(self._paths, self.message)
            _size_arrays(self._paths, self.message)
            self._blocks = blocks(self._paths, self.message, signal.covariance)
        except ValueError as error:
            raise ValueError(f"signal '{signal.topic}': {error}") from None
        self.size = len(self._paths)
        self._readers = [reader(path, self.message) for path in self._paths]
        #: Covariances that may declare a field as absent.
        self.declaring = declaring(self._paths, self.message)
        self._has_limits = signal.type == _RANGE and 'range' in signal.fields
        covered = sum(len(block.own) for block in self._blocks)
        self.carries_covariance = covered == self.size
        self.has_covariance = covered > 0
        self._reads = [
            (block, flat_indices(block.own, self.size), flat_indices(block.rows, block.size))
            for block in self._blocks
        ]
        self._write = _writer(self._paths, self.message)
        self._covariances = _covariance_views(self._blocks, self.message, self.size)
        header = getattr(self.message, 'header', None)
        self._stamp = None if header is None else header.stamp
        if header is not None:
            header.frame_id = frame
        if hasattr(self.message, 'child_frame_id'):
            self.message.child_frame_id = child_frame

    def decode(self, message: Any) -> Array:
        """Return the vector (n,) in a message.

        Raises
        ------
        LookupError
            If an array of the message is too short or lacks a name.
        AbsentError
            If the message declares a field as absent, or its range is beyond its limits.
        """
        if self.declaring:
            refuse_absent(self.declaring, self.declarations(message))
        if self._has_limits:
            _refuse_beyond(message)
        return np.array([read(message) for read in self._readers], dtype=float)

    def declarations(self, message: Any) -> list[float]:
        """Return the first elements of the covariances that may declare a field as absent."""
        return [float(walk(message, way)[0]) for way in self.declaring]

    def decode_covariance(self, message: Any) -> Array | None:
        """Return the covariance (n, n) in a message; None if it does not cover every field.

        Raises
        ------
        ValueError
            If an array of the message has the wrong size.
        """
        if not self.carries_covariance:
            return None
        covariance = np.zeros(self.size**2)
        for block, indices, rows in self._reads:
            covariance[indices] = block.values(message)[rows]
        return covariance.reshape(self.size, self.size)

    def encode(self, time: int, values: Array, covariance: Array | None = None) -> Any:
        """Return the message with these values (n,), stamped ``time`` in nanoseconds.

        Parts of the covariance (n, n) without a place in the message are omitted.
        """
        if self._stamp is not None:
            write_stamp(self._stamp, time)
        self._write(values.tolist())
        if covariance is not None:
            flat = covariance.ravel()
            for view, rows, indices in self._covariances:
                view[rows] = flat[indices]
        return self.message


def _refuse_beyond(message: Any) -> None:
    """Raise AbsentError if a range is outside of the limits of its message, if that has any."""
    low, high, distance = message.min_range, message.max_range, message.range
    if low < high and (distance < low or distance > high):
        raise AbsentError(f'range {distance:.4g} is outside of {low:.4g} to {high:.4g}')


def named(values: Signal, names: tuple[str, ...]) -> Signal:
    """Return the ``sensor_msgs/JointState`` signal of named values on the topic of ``values``."""
    return Signal(values.topic, 'sensor_msgs/JointState', tuple(f'position[{n}]' for n in names))


def _check_quaternions(paths: list[Path], message: Any) -> None:
    """Raise ValueError unless a quaternion is read as angles, or as a whole rotation vector."""
    for path in paths:
        if path.attribute in VECTOR and is_quaternion(walk(message, path.parent)):
            attributes = {other.attribute for other in paths if other.parent == path.parent}
            if attributes != {*VECTOR}:
                others = ', '.join(name for name in (*VECTOR, *ANGLES) if name in attributes)
                raise ValueError(
                    f"fields: '{path.text}' goes with {', '.join(VECTOR)} alone, got {others}"
                )


def _size_arrays(paths: list[Path], message: Any) -> None:
    """Extend every array in a path to its length, and write names beside it."""
    for path in paths:
        size_arrays(path.way, message)
        if path.index is None and path.name is None:
            continue
        owner, attribute = walk(message, path.parent), path.attribute
        if path.name is not None and path.name not in owner.name:
            owner.name = [*owner.name, path.name]
        length = len(owner.name) if path.index is None else path.index + 1
        values = getattr(owner, attribute)
        if len(values) < length:
            convert = converter(path.kind)
            setattr(owner, attribute, [0.0 if convert is None else convert(0.0)] * length)


def _writer(paths: list[Path], message: Any) -> Callable[[list[float]], None]:
    """Return a function that writes numbers into ``message`` in place."""
    slots: list[tuple[Any, str | int, Any]] = []
    turns: dict[Way, dict[str, int]] = {}
    for number, path in enumerate(paths):
        owner = walk(message, path.parent)
        if path.attribute in (*ANGLES, *VECTOR) and is_quaternion(owner):
            turns.setdefault(path.parent, {})[path.attribute] = number
            slots.append((_NOWHERE, 0, None))
        elif path.index is not None:
            slots.append((getattr(owner, path.attribute), path.index, converter(path.kind)))
        elif path.name is not None:
            place = owner.name.index(path.name)
            slots.append((getattr(owner, path.attribute), place, converter(path.kind)))
        else:
            slots.append((owner, path.attribute, converter(path.kind)))
    quaternions = [
        (*((write_vector, VECTOR) if VECTOR[0] in which else (write_euler, ANGLES)), way, which)
        for way, which in turns.items()
    ]
    rotations = [
        (turn, walk(message, way), [which.get(name) for name in names])
        for turn, names, way, which in quaternions
    ]

    def write(values: list[float]) -> None:
        for (owner, place, convert), value in zip(slots, values):
            number = value if convert is None else convert(value)
            if isinstance(place, str):
                setattr(owner, place, number)
            else:
                owner[place] = number
        for turn, quaternion, numbers in rotations:
            turn(quaternion, *(0.0 if n is None else values[n] for n in numbers))

    return write


#: Target of the angles, which are written together as a quaternion.
_NOWHERE = [0.0]


def _covariance_views(
    blocks: tuple[Block, ...], message: Any, size: int
) -> list[tuple[Any, Any, Any]]:
    """Return, for each block, a flat view into the message, the target and source indices."""
    views: list[tuple[Any, Any, Any]] = []
    for block in blocks:
        owner, attribute = walk(message, block.way[:-1]), str(block.way[-1])
        array = getattr(owner, attribute)
        if isinstance(array, float):
            views.append((_Scalar(owner, attribute), 0, block.own[0] * (size + 1)))
            continue
        if len(array) != block.size**2:
            setattr(owner, attribute, [0.0] * block.size**2)
            array = getattr(owner, attribute)
        indices = flat_indices(block.own, size)
        views.append((np.frombuffer(array), flat_indices(block.rows, block.size), indices))
    return views


class _Scalar:
    """A single variance of a message, which is written like an array."""

    def __init__(self, owner: Any, attribute: str) -> None:
        self._owner, self._attribute = owner, attribute

    def __setitem__(self, _: int, value: float) -> None:
        setattr(self._owner, self._attribute, float(value))
