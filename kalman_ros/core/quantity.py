# SPDX-License-Identifier: Apache-2.0
"""What the fields of messages read, by their names: places, attitudes and vectors."""

from __future__ import annotations

import re
from typing import NamedTuple

#: What a field of a message reads.
PLACE, ATTITUDE, VELOCITY, ACCELERATION, RATE, VECTOR = (
    'position', 'attitude', 'velocity', 'acceleration', 'rate', 'vector'
)  # fmt: skip
_GLOBAL = ('east', 'north', 'up')
ANGLES = ('roll', 'pitch', 'yaw')
#: By the last attribute that owns x, y and z.
_OWNERS = {
    'position': PLACE, 'point': PLACE, 'translation': PLACE, 'linear': VELOCITY,
    'linear_acceleration': ACCELERATION, 'angular': RATE, 'angular_velocity': RATE,
}  # fmt: skip
_FIELD = re.compile(r'(?:(?P<owner>.*)\.)?(?P<last>x|y|z|roll|pitch|yaw|east|north|up)')


class Quantity(NamedTuple):
    """What a field reads: its kind, which axis of three, and the path of all three."""

    kind: str
    axis: int
    owner: str

    def siblings(self) -> tuple[str, ...]:
        """Return the fields of all three axes."""
        start = f'{self.owner}.' if self.owner else ''
        return tuple(f'{start}{axis}' for axis in (ANGLES if self.kind == ATTITUDE else 'xyz'))


def quantity(field: str) -> Quantity | None:
    """Return what a field reads, by its name; None for a number that is not of three."""
    found = _FIELD.fullmatch(field)
    if found is None:
        return None
    owner, last = found['owner'] or '', found['last']
    if last in _GLOBAL:
        return Quantity(PLACE, _GLOBAL.index(last), owner)
    if last in ANGLES:
        return Quantity(ATTITUDE, ANGLES.index(last), owner)
    attribute = owner.rpartition('.')[2].partition('[')[0]
    kind = _OWNERS.get(attribute, VECTOR)
    if kind is VELOCITY and '.accel.' in f'.{owner}':
        kind = ACCELERATION
    return Quantity(kind, 'xyz'.index(last), owner)
