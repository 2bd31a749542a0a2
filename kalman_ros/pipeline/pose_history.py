# SPDX-License-Identifier: Apache-2.0
"""The way of a frame in another one, over time."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable
from functools import reduce

from kalman_ros.codecs.transform_list import StampedTransform
from kalman_ros.core import rotations as so3

from .frames import Placement, placement_of

#: Largest number of poses, and of frames, that are kept.
_MOST_POSES, _MOST_FRAMES = 1000, 1000


class PoseHistory:
    """The last poses of a body, in the order of their stamps."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_MOST_POSES)
        self._poses: deque[Placement] = deque(maxlen=_MOST_POSES)

    def add(self, time: int, pose: Placement) -> None:
        """Add a pose at ``time``, in nanoseconds, in place of an earlier one of that time.

        A clock that goes back empties the history.
        """
        if self._times and time < self._times[-1]:
            self._times.clear()
            self._poses.clear()
        if self._times and time == self._times[-1]:
            self._poses[-1] = pose
            return
        self._times.append(time)
        self._poses.append(pose)

    def at(self, time: int, tolerance: float) -> Placement | None:
        """Return the pose at ``time``, interpolated between two poses.

        Beyond the ends it is the pose at the end, if no further away than ``tolerance`` seconds.
        """
        if not self._times:
            return None
        index = bisect_left(self._times, time)
        if index == len(self._times) or index == 0:
            nearest = min(index, len(self._times) - 1)
            near = abs(self._times[nearest] - time) <= tolerance * 1e9
            return self._poses[nearest] if near else None
        before, after = self._poses[index - 1], self._poses[index]
        start, end = self._times[index - 1], self._times[index]
        share = (time - start) / (end - start)
        turn = so3.compose(after.rotation, -before.rotation)
        place = before.translation + share * (after.translation - before.translation)
        return Placement(place, so3.compose(share * turn, before.rotation))


class FrameHistory:
    """The placements of ``frame`` in ``base``, by the transforms of other nodes between them.

    Where several change, they hold until the earliest of their stamps, as for tf2; where none
    does, they hold at any time.
    """

    def __init__(self, base: str, frame: str) -> None:
        self._base, self._frame = base, frame
        #: The transform to each frame from its parent, and whether it is static.
        self._links: dict[str, tuple[StampedTransform, bool]] = {}
        self._way: list[tuple[StampedTransform, bool]] = []
        self._history = PoseHistory()
        self._constant: Placement | None = None

    def add(self, transforms: Iterable[StampedTransform], *, static: bool) -> None:
        """Add the transforms of a message."""
        for transform in transforms:
            if len(self._links) < _MOST_FRAMES or transform.child in self._links:
                self._links[transform.child] = transform, static
        way = self._found_way()
        if way != self._way:
            self._way = way
            self._note()

    def _note(self) -> None:
        """Add the placement by the transforms as they are now."""
        placements = [placement_of(transform) for transform, _ in self._way]
        good = [each for each in placements if each is not None]
        if not good or len(good) < len(placements):
            return
        placement = reduce(lambda inner, outer: outer.then(inner), good)
        times = [transform.time for transform, static in self._way if not static]
        self._constant = None if times else placement
        if times:
            self._history.add(min(times), placement)

    def at(self, time: int, tolerance: float) -> Placement | None:
        """Return the placement at ``time``, as `PoseHistory` does."""
        return self._constant or self._history.at(time, tolerance)

    def _found_way(self) -> list[tuple[StampedTransform, bool]]:
        """Return the transforms from ``frame`` up to ``base``; none if they are not connected."""
        found: list[tuple[StampedTransform, bool]] = []
        frame = self._frame
        while frame != self._base:
            if frame not in self._links or len(found) == len(self._links):
                return []
            found.append(self._links[frame])
            frame = found[-1][0].parent
        return found
