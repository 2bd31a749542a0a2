# SPDX-License-Identifier: Apache-2.0
"""Dotted paths into messages: ``pose.pose.position.x``, ``position[hip]``, ``poses[2].x``.

A path is resolved once, against an instance of its message type: a misspelt field is
refused when a node is built, and reading and writing are plain attribute access.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import asin, atan2, copysign, cos, pi, sin, sqrt
from operator import attrgetter
from typing import Any, Union

from .messages import message_type
from .numbers import array_of, number_kind

_STEP = re.compile(r'([A-Za-z_]\w*)(?:\[([^\]]+)\])?(?:\.(?=.)|$)')
#: The steps of a path: attributes, and indices into arrays of messages.
Way = tuple[Union[str, int], ...]
#: Largest size of an array of numbers.
_LONGEST = 100_000
#: Largest number of names in an error message; a message may have any number.
_FEW = 8
#: Computed numbers of a quaternion: its angles, and its rotation vector.
ANGLES = ('roll', 'pitch', 'yaw')
VECTOR = ('rx', 'ry', 'rz')


@dataclass(frozen=True)
class Path:
    """A path into a message: a way, and an index or a name in a final array of numbers.

    ``kind`` is the type of the number, ``double`` or ``int32``.
    """

    text: str
    way: Way
    index: int | None
    name: str | None
    kind: str

    @property
    def parent(self) -> Way:
        """Way to the object that has the last attribute."""
        return self.way[:-1]

    @property
    def attribute(self) -> str:
        """Last attribute."""
        return str(self.way[-1])


def parse(text: str, sample: Any) -> Path:
    """Return the path ``text``, checked against the message instance ``sample``.

    Raises
    ------
    ValueError
        If the path is not well formed or the message has no such field.
    """
    *onward, (last, bracket) = _steps(text)
    way: list[str | int] = []
    owner = sample
    for attribute, inner in onward:
        owner, declared = _field(owner, attribute, text)
        way.append(attribute)
        if inner:
            owner = _element(declared, inner, text)
            way.append(int(inner))
    _, declared = _field(owner, last, text)
    held, most = array_of(declared) if bracket else (declared, None)
    index = _index(bracket, most, text) if bracket.isdecimal() else None
    name = bracket if bracket and index is None else None
    if name is not None and not hasattr(owner, 'name'):
        raise ValueError(f"fields: '{text}' needs a message with an array 'name' beside '{last}'")
    kind = number_kind(held)
    if not kind:
        expected = 'in an array of numbers' if bracket else 'a number'
        raise ValueError(f"fields: '{text}' is not {expected}")
    return Path(text, (*way, last), index, name, kind)


def _steps(text: str) -> list[tuple[str, str]]:
    """Return the attributes of a path, each with the text in its brackets."""
    steps, at = [], 0
    while match := _STEP.match(text, at):
        steps.append((match[1], match[2] or ''))
        at = match.end()
        if at == len(text):
            return steps
    raise ValueError(f"fields: expected a path such as 'pose.pose.position.x', got '{text}'")


def _index(inner: str, most: int | None, text: str) -> int:
    """Return the index of an element in an array of at most ``most`` elements."""
    most = _LONGEST if most is None else most
    if int(inner) >= most:
        raise ValueError(f"fields: expected an index below {most}, got '{text}'")
    return int(inner)


def _field(owner: Any, attribute: str, text: str) -> tuple[Any, str]:
    """Return an attribute of a message and its declared type."""
    if attribute in (*ANGLES, *VECTOR) and is_quaternion(owner):
        return 0.0, 'double'
    known = owner.get_fields_and_field_types() if hasattr(owner, 'SLOT_TYPES') else {}
    if attribute not in known:
        offers = f'it has {", ".join(known)}' if known else 'it is a plain value'
        if isinstance(owner, list):
            offers = "it is an array, in which '[0]' is the first"
        kind = type(owner).__name__
        raise ValueError(f"fields: no '{attribute}' in {kind} for '{text}'; {offers}")
    return getattr(owner, attribute), known[attribute]


def _element(declared: str, inner: str, text: str) -> Any:
    """Return a default element of an array of messages."""
    kind, most = array_of(declared)
    if '/' not in kind or not inner.isdecimal():
        raise ValueError(f"fields: '[{inner}]' in '{text}' is no place in an array of messages")
    _index(inner, most, text)
    return message_type(kind)()


def size_arrays(way: Way, message: Any) -> None:
    """Extend every array of messages on the way to the length that the way needs."""
    for depth, step in enumerate(way):
        if isinstance(step, int):
            owner, attribute = walk(message, way[: depth - 1]), str(way[depth - 1])
            elements = getattr(owner, attribute)
            if len(elements) <= step:
                held, _ = array_of(owner.get_fields_and_field_types()[attribute])
                kind = message_type(held)
                more = [kind() for _ in range(step + 1 - len(elements))]
                setattr(owner, attribute, [*elements, *more])


def walk(message: Any, way: Way) -> Any:
    """Return the object at the end of ``way``; LookupError if an array is too short."""
    for step in way:
        message = message[step] if isinstance(step, int) else getattr(message, step)
    return message


def _getter(way: Way) -> Callable[[Any], Any]:
    """Return a function that follows ``way``; faster than `walk` if it has only attributes."""
    names = [step for step in way if isinstance(step, str)]
    return attrgetter('.'.join(names)) if len(names) == len(way) else partial(walk, way=way)


def is_quaternion(value: Any) -> bool:
    """Return whether a message is a ``geometry_msgs/Quaternion``."""
    return type(value).__name__ == 'Quaternion'


def reader(path: Path, sample: Any) -> Callable[[Any], float]:
    """Return a function that reads the number at ``path`` out of a message like ``sample``.

    The function raises LookupError where an array is too short or has no such name.
    """
    computed = (*ANGLES, *VECTOR)
    if path.attribute in computed and path.parent and is_quaternion(walk(sample, path.parent)):
        parent, which = _getter(path.parent), computed.index(path.attribute)
        if which < len(ANGLES):
            return lambda message: euler(parent(message))[which]
        return lambda message: rotation_vector(parent(message))[which - len(ANGLES)]
    get = _getter(path.way)
    if path.index is not None:
        index = path.index
        return lambda message: _at(get(message), index, path)
    if path.name is not None:
        name = path.name
        owner = _getter((*path.parent, 'name'))
        return lambda message: _at(get(message), _position(owner(message), name), path)
    return get


def _at(values: Any, index: int, path: Path) -> float:
    try:
        return float(values[index])
    except IndexError:
        expected = f'expected at least {index + 1} numbers, got {len(values)}'
        raise LookupError(f'{path.text}: {expected}') from None


def _position(names: list[str], name: str) -> int:
    try:
        return names.index(name)
    except ValueError:
        few = ', '.join(names[:_FEW]) + (', ...' if len(names) > _FEW else '')
        raise LookupError(f"no '{name}' among ({few:.200})") from None


def euler(q: Any) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a quaternion of any length (REP-103, fixed axes x, y, z).

    J. Diebel, Representing Attitude (2006), section 8.2; a zero quaternion reads NaN.
    """
    x, y, z, w = q.x, q.y, q.z, q.w
    norm = x * x + y * y + z * z + w * w
    if not norm > 0.0:
        return float('nan'), float('nan'), float('nan')
    sine = 2.0 * (w * y - z * x) / norm
    pitch = asin(sine) if abs(sine) < 1.0 else copysign(pi / 2.0, sine)
    roll = atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    return roll, pitch, atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def rotation_vector(q: Any) -> tuple[float, float, float]:
    """Return the rotation vector of a quaternion of any length; a zero quaternion reads NaN.

    The axis times the angle, at most pi: J. Diebel, Representing Attitude (2006), section 7.
    """
    x, y, z, w = q.x, q.y, q.z, q.w
    n = sqrt(x * x + y * y + z * z)
    if not n > 0.0:
        nothing = 0.0 if abs(w) > 0.0 else float('nan')
        return nothing, nothing, nothing
    share = 2.0 * atan2(n, abs(w)) / (n if w >= 0.0 else -n)
    return share * x, share * y, share * z


def write_vector(q: Any, rx: float, ry: float, rz: float) -> None:
    """Write the unit quaternion of a rotation vector into ``q``, in place."""
    angle = sqrt(rx * rx + ry * ry + rz * rz)
    share = sin(angle / 2.0) / angle if angle > 0.0 else 0.5
    q.x, q.y, q.z, q.w = share * rx, share * ry, share * rz, cos(angle / 2.0)


def write_euler(q: Any, roll: float, pitch: float, yaw: float) -> None:
    """Write the unit quaternion of roll, pitch and yaw into ``q``, in place."""
    cr, sr = cos(roll / 2.0), sin(roll / 2.0)
    cp, sp = cos(pitch / 2.0), sin(pitch / 2.0)
    cy, sy = cos(yaw / 2.0), sin(yaw / 2.0)
    q.w = cr * cp * cy + sr * sp * sy
    q.x = sr * cp * cy - cr * sp * sy
    q.y = cr * sp * cy + sr * cp * sy
    q.z = cr * cp * sy - sr * sp * cy
