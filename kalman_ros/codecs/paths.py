# SPDX-License-Identifier: Apache-2.0
"""Dotted paths into messages: ``pose.pose.position.x``, ``position[hip]``, ``data[3]``.

A path is resolved once, against an instance of its message type, so that a misspelt field is
refused where a node is built and reading and writing are plain attribute access.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import asin, atan2, copysign, cos, pi, sin
from operator import attrgetter
from typing import Any

from .numbers import element_kind, number_kind

_PATH = re.compile(r'^([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\[([^\]]+)\])?$')
#: No array that is fused has more numbers.
_LONGEST = 100_000
ANGLES = ('roll', 'pitch', 'yaw')


@dataclass(frozen=True)
class Path:
    """A path into a message: a way of attributes, and an index or a name at its end.

    ``kind`` is that of the number there, ``double`` or ``int32``.
    """

    text: str
    way: tuple[str, ...]
    index: int | None
    name: str | None
    kind: str

    @property
    def parent(self) -> tuple[str, ...]:
        """The attributes before the last."""
        return self.way[:-1]


def parse(text: str, sample: Any) -> Path:
    """Return the path ``text``, checked against the message instance ``sample``.

    Raises
    ------
    ValueError
        If the path is not well formed or the message has no such field.
    """
    match = _PATH.match(text)
    if match is None:
        raise ValueError(f"fields: expected a path such as 'pose.pose.position.x', got '{text}'")
    way = tuple(match[1].split('.'))
    at, declared = sample, ''
    for attribute in way:
        if attribute in ANGLES and is_quaternion(at):
            at, declared = 0.0, 'double'
            continue
        known = at.get_fields_and_field_types() if hasattr(at, 'SLOT_TYPES') else {}
        if attribute not in known:
            offers = f'it has {", ".join(known)}' if known else 'it is a plain value'
            kind = type(at).__name__
            raise ValueError(f"fields: no '{attribute}' in {kind} for '{text}'; {offers}")
        at, declared = getattr(at, attribute), known[attribute]
    bracket = match[2]
    index = int(bracket) if bracket is not None and bracket.isdecimal() else None
    if index is not None and index >= _LONGEST:
        raise ValueError(f"fields: expected an index below {_LONGEST}, got '{text}'")
    name = bracket if index is None else None
    if name is not None and not hasattr(walk(sample, way[:-1]), 'name'):
        raise ValueError(
            f"fields: '{text}' needs a message with an array 'name' beside '{way[-1]}'"
        )
    kind, most = element_kind(declared) if bracket else (number_kind(declared), None)
    if not kind:
        wanted = 'in an array of numbers' if bracket else 'a number'
        raise ValueError(f"fields: '{text}' is not {wanted}")
    if index is not None and most is not None and index >= most:
        raise ValueError(f"fields: '{text}' is beyond the end of {most} numbers")
    return Path(text, way, index, name, kind)


def walk(message: Any, way: tuple[str, ...]) -> Any:
    """Return what is found along ``way``."""
    return attrgetter('.'.join(way))(message) if way else message


def is_quaternion(value: Any) -> bool:
    """Tell whether a message is a ``geometry_msgs/Quaternion``."""
    return type(value).__name__ == 'Quaternion'


def reader(path: Path, sample: Any) -> Callable[[Any], float]:
    """Return a function that reads the number at ``path`` out of a message like ``sample``.

    The function raises LookupError where an array is too short or has no such name.
    """
    if path.way[-1] in ANGLES and path.parent and is_quaternion(walk(sample, path.parent)):
        parent, which = attrgetter('.'.join(path.parent)), ANGLES.index(path.way[-1])
        return lambda message: euler(parent(message))[which]
    get: Callable[[Any], Any] = attrgetter('.'.join(path.way))
    if path.index is not None:
        index = path.index
        return lambda message: float(get(message)[index])
    if path.name is not None:
        name = path.name
        owner = attrgetter('.'.join((*path.parent, 'name')))
        return lambda message: float(get(message)[_position(owner(message), name)])
    return get


def _position(names: list[str], name: str) -> int:
    try:
        return names.index(name)
    except ValueError:
        raise LookupError(f"no '{name}' among ({', '.join(names)})") from None


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


def write_euler(q: Any, roll: float, pitch: float, yaw: float) -> None:
    """Write the unit quaternion of roll, pitch and yaw into ``q``, in place."""
    cr, sr = cos(roll / 2.0), sin(roll / 2.0)
    cp, sp = cos(pitch / 2.0), sin(pitch / 2.0)
    cy, sy = cos(yaw / 2.0), sin(yaw / 2.0)
    q.w = cr * cp * cy + sr * sp * sy
    q.x = sr * cp * cy - cr * sp * sy
    q.y = cr * sp * cy + sr * cp * sy
    q.z = cr * cp * sy - sr * sp * cy
