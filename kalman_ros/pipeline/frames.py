# SPDX-License-Identifier: Apache-2.0
"""Frames and their placements in each other, by transforms of other nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kalman_ros.codecs.transform_list import StampedTransform, transforms_in
from kalman_ros.core import Array
from kalman_ros.core import rotations as so3

#: The topics of transforms, and of those that do not change.
TF, STATIC = '/tf', '/tf_static'
#: Largest number of frames that are kept.
_MOST_FRAMES = 1_000
#: A smaller change, in m or rad, is rounding.
_SAME = 1e-9


class Placement(NamedTuple):
    """A frame in another: a translation (3,) and a rotation vector (3,)."""

    translation: Array
    rotation: Array

    def then(self, inner: Placement) -> Placement:
        """Return the placement of a frame that is placed in this one."""
        moved = self.translation + so3.rotate(self.rotation, inner.translation)
        return Placement(moved, so3.compose(self.rotation, inner.rotation))

    def inverse(self) -> Placement:
        """Return the placement of the other frame in this one."""
        return Placement(-so3.rotate_back(self.rotation, self.translation), -self.rotation)

    def differs_from(self, other: Placement) -> bool:
        """Return whether the placements differ by more than rounding."""
        turned = so3.compose(-other.rotation, self.rotation)
        moved = self.translation - other.translation
        return bool(np.abs((moved, turned)).max() > _SAME)


_HERE = Placement(np.zeros(3), np.zeros(3))


def placement_of(transform: StampedTransform) -> Placement:
    """Return the placement by a transform that is rigid."""
    q = np.array(transform.quaternion)
    return Placement(np.array(transform.translation), so3.from_quaternion(q / np.abs(q).max()))


class Frames:
    """The placements of frames in their parents by transforms, and so in each other."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Placement]] = {}
        #: Frames whose transform is on ``/tf``, where it is published again and again.
        self._moving: set[str] = set()
        #: Frames whose last transform cannot be used.
        self.refused: set[str] = set()

    def add(self, data: bytes, *, moving: bool = False) -> None:
        """Add the transforms in a message, except any that is not finite or not a rotation.

        Those of ``/tf`` are ``moving``, those of ``/tf_static`` are not.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        """
        for transform in transforms_in(data):
            child = transform.child
            if not transform.is_rigid:
                if len(self.refused) < _MOST_FRAMES:
                    self.refused.add(child)
            elif child in self._parents or len(self._parents) < _MOST_FRAMES:
                self.refused.discard(child)
                self._parents[child] = transform.parent, placement_of(transform)
                (self._moving.add if moving else self._moving.discard)(child)

    def moves_in(self, frame: str, outer: str) -> bool:
        """Return whether ``frame`` is moved within ``outer`` by another node, as by AMCL."""
        moved = False
        for name, _ in self._above(frame):
            if name == outer:
                return moved
            moved |= name in self._moving
        return False

    def placement(self, frame: str, base: str) -> Placement | None:
        """Return the placement of ``frame`` in ``base``; None if no transforms connect them."""
        above = dict(self._above(base))
        for name, placement in self._above(frame):
            if name in above:
                return above[name].inverse().then(placement)
        return None

    def _above(self, frame: str) -> Iterator[tuple[str, Placement]]:
        """Yield ``frame`` and each frame above it, with the placement of ``frame`` in it."""
        placement, seen = _HERE, set()
        while frame not in seen:
            yield frame, placement
            seen.add(frame)
            if frame not in self._parents:
                return
            frame, place = self._parents[frame]
            placement = place.then(placement)
