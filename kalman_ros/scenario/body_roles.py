# SPDX-License-Identifier: Apache-2.0
"""Which coordinates of a state are the position and the motion of a body."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from kalman_ros.core import Array, Signal, Space
from kalman_ros.core import rotations as so3

#: The roles, by the end of a field of the state's message.
_FIELDS = {
    **{f'position.{axis}': axis for axis in 'xyz'},
    **{f'orientation.{turn}': turn for turn in ('roll', 'pitch', 'yaw', 'rx', 'ry', 'rz')},
    **{f'linear.{axis}': f'v{axis}' for axis in 'xyz'},
    **{f'angular.{axis}': f'w{axis}' for axis in 'xyz'},
}
#: Other names of roles, where a state goes by the names of its coordinates.
_NAMES = {'psi': 'yaw', 'theta': 'yaw', 'heading': 'yaw', 'v': 'vx', 'omega': 'wz', 'a': 'ax'}
_EULER, _VECTOR = ('roll', 'pitch', 'yaw'), ('rx', 'ry', 'rz')
_NAMED = re.compile(r'position\[(.+)\]')


@dataclass(frozen=True)
class Body:
    """The indices of the coordinates of a state by their roles.

    Roles are x, y, z; roll, pitch, yaw, or rx, ry, rz, a rotation vector; vx, vy, vz and wx, wy,
    wz, the velocity and the angular rate along the axes of the body; ax, ay, az.
    """

    index: dict[str, int] = field(hash=False)

    @property
    def position(self) -> tuple[str, ...]:
        """The directions x, y, z that the state has."""
        return tuple(axis for axis in 'xyz' if axis in self.index)

    @property
    def has_rotation(self) -> bool:
        """Whether the attitude is a rotation vector."""
        return self.index.keys() >= {*_VECTOR}

    @property
    def turns(self) -> bool:
        """Whether the state has a heading."""
        return 'yaw' in self.index or self.has_rotation

    def attitude(self, x: Array) -> Array:
        """Return the rotation vector (..., 3) from the axes of the body to those of the world."""
        angles = not self.has_rotation
        r = np.stack([self.value(x, role) for role in (_EULER if angles else _VECTOR)], axis=-1)
        return so3.from_euler(r) if angles else r

    def value(self, x: Array, role: str) -> Array:
        """Return the coordinate (...) of states (..., n) that has a role, or zero."""
        index = self.index.get(role)
        return np.zeros(x.shape[:-1]) if index is None else x[..., index]

    @property
    def moves(self) -> bool:
        """Whether the state has a position in the plane."""
        return {'x', 'y'} <= self.index.keys()


def body_of(state: Space, signal: Signal) -> Body:
    """Return the body of a state, by the fields of its message and then by its names."""
    indices: dict[str, int] = {}
    for index, (name, path) in enumerate(zip(state.names, signal.fields)):
        role = next((role for end, role in _FIELDS.items() if path.endswith(end)), '')
        if not role and _NAMED.fullmatch(path):
            role = _NAMES.get(name, name)
        if role:
            indices.setdefault(role, index)
    return Body(indices)
