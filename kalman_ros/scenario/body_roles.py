# SPDX-License-Identifier: Apache-2.0
"""Which coordinates of a state are the position and the motion of a body."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kalman_ros.core import Signal, Space

#: The roles, by the end of a field of the state's message.
_FIELDS = {
    **{f'position.{axis}': axis for axis in 'xyz'},
    **{f'orientation.{angle}': angle for angle in ('roll', 'pitch', 'yaw')},
    **{f'linear.{axis}': f'v{axis}' for axis in 'xyz'},
    **{f'angular.{axis}': f'w{axis}' for axis in 'xyz'},
}
#: Other names of roles, where a state goes by the names of its coordinates.
_NAMES = {'psi': 'yaw', 'theta': 'yaw', 'heading': 'yaw', 'v': 'vx', 'omega': 'wz', 'a': 'ax'}
_NAMED = re.compile(r'position\[(.+)\]')


@dataclass(frozen=True)
class Body:
    """The indices of the coordinates of a state by their roles.

    Roles are x, y, z; roll, pitch, yaw; vx, vy, vz and wx, wy, wz, the velocity and the angular
    rate along the axes of the body; ax, ay, az.
    """

    index: dict[str, int]

    @property
    def position(self) -> tuple[str, ...]:
        """The directions x, y, z that the state has."""
        return tuple(axis for axis in 'xyz' if axis in self.index)

    @property
    def moves(self) -> bool:
        """Whether the state has a position in the plane."""
        return {'x', 'y'} <= self.index.keys()


def body_of(state: Space, signal: Signal) -> Body:
    """Return the body of a state, by the fields of its message and then by its names."""
    found: dict[str, int] = {}
    for index, (name, field) in enumerate(zip(state.names, signal.fields)):
        role = next((role for end, role in _FIELDS.items() if field.endswith(end)), '')
        if not role and _NAMED.fullmatch(field):
            role = _NAMES.get(name, name)
        if role:
            found.setdefault(role, index)
    return Body(found)
