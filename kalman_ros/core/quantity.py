# SPDX-License-Identifier: Apache-2.0
"""Quantities in the fields of messages, by their names: places, attitudes and vectors."""

from __future__ import annotations

import re
from typing import NamedTuple

#: Kinds of quantity in a field of a message.
PLACE, ATTITUDE, VELOCITY, ACCELERATION, RATE, VECTOR = (
    'position', 'attitude', 'velocity', 'acceleration', 'rate', 'vector'
)  # fmt: skip
#: East, north and up of a plane that touches the Earth at a datum.
GLOBAL = ('east', 'north', 'up')
_AXES = ('x', 'y', 'z')
#: An attitude is read as angles about fixed axes, or as a rotation vector.
ANGLES, ROTATION = ('roll', 'pitch', 'yaw'), ('rx', 'ry', 'rz')
#: Kind of quantity by the last attribute that owns x, y and z.
_OWNERS = {
    'position': PLACE, 'point': PLACE, 'translation': PLACE, 'linear': VELOCITY,
    'linear_acceleration': ACCELERATION, 'angular': RATE, 'angular_velocity': RATE,
}  # fmt: skip
_FIELD = re.compile(r'(?:(?P<owner>.*)\.)?(?P<last>r?[xyz]|roll|pitch|yaw|east|north|up)')


class Quantity(NamedTuple):
    """Quantity in a field: its kind, its axis out of three, the path of all, and their names."""

    kind: str
    axis: int
    owner: str
    names: tuple[str, ...]

    def siblings(self) -> tuple[str, ...]:
        """Return the fields of all three axes."""
        start = f'{self.owner}.' if self.owner else ''
        return tuple(f'{start}{name}' for name in self.names)


def quantity(field: str) -> Quantity | None:
    """Return the quantity in a field, by its name; None for a number that is not one of three."""
    match = _FIELD.fullmatch(field)
    if match is None:
        return None
    owner, last = match['owner'] or '', match['last']
    for kind, names in ((PLACE, GLOBAL), (ATTITUDE, ANGLES), (ATTITUDE, ROTATION)):
        if last in names:
            return Quantity(kind, names.index(last), owner, names)
    attribute = owner.rpartition('.')[2].partition('[')[0]
    kind = _OWNERS.get(attribute, VECTOR)
    if kind is VELOCITY and '.accel.' in f'.{owner}':
        kind = ACCELERATION
    return Quantity(kind, _AXES.index(last), owner, _AXES)


def quantities(fields: tuple[str, ...]) -> list[Quantity]:
    """Return the quantities of fields, each group of three axes once."""
    known = filter(None, map(quantity, fields))
    return list({(group.owner, group.names): group for group in known}.values())
