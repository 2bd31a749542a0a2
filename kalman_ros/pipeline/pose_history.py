# SPDX-License-Identifier: Apache-2.0
"""The way of a frame in another one, over time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable
from math import sin

import numpy as np

from kalman_ros.codecs.transform_list import StampedTransform
from kalman_ros.core import rotations as so3

from .frames import Placement, placement_of

#: Largest number of poses, and of frames, that are kept.
_MOST_POSES, _MOST_FRAMES = 1000, 10_000
#: Nanoseconds by which a pose may be older than the last one, which it then does not replace; a
#: clock that goes back further begins a new history.
_OUT_OF_ORDER = 1_000_000_000
#: Nanoseconds in which a body moves on as it did in the time before its last pose.
_MOTION = 100_000_000
#: Half of a turn below which an arc is straight.
_STRAIGHT = 1e-6


class PoseHistory:
    """The last poses of a body, in the order of their stamps."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_MOST_POSES)
        self._poses: deque[Placement] = deque(maxlen=_MOST_POSES)

    def add(self, time: int, pose: Placement) -> None:
        """Add a pose at ``time``, in nanoseconds, in place of an earlier one of that time.

        One that is a little older than the last one is left out; a clock that goes back empties
        the history.
        """
        if self._times and time < self._times[-1]:
            if self._times[-1] - time <= _OUT_OF_ORDER:
                return
            self._times.clear()
            self._poses.clear()
        if self._times and time == self._times[-1]:
            self._poses[-1] = pose
            return
        self._times.append(time)
        self._poses.append(pose)

    def at(self, time: int, tolerance: float) -> Placement | None:
        """Return the pose at ``time``, interpolated between two poses.

        Beyond the ends, but by no more than ``tolerance`` seconds, it is the first pose, or where
        the body is if it moves on as it did before the last one.
        """
        if not self._times:
            return None
        index = bisect_left(self._times, time)
        if index == len(self._times) or index == 0:
            end = self._times[min(index, len(self._times) - 1)]
            if abs(end - time) > tolerance * 1e9:
                return None
            return self._poses[0] if index == 0 else self._ahead(time)
        before, after = self._poses[index - 1], self._poses[index]
        start, end = self._times[index - 1], self._times[index]
        share = (time - start) / (end - start)
        turn = so3.compose(after.rotation, -before.rotation)
        place = before.translation + share * (after.translation - before.translation)
        return Placement(place, so3.compose(share * turn, before.rotation))

    def _ahead(self, time: int) -> Placement:
        """Return the pose at a time after the last one, with the same twist."""
        last, end = self._poses[-1], self._times[-1]
        start = bisect_right(self._times, end - _MOTION) - 1
        if start < 0 or time == end:
            return last
        # the chord of an arc is turned by half of it against the pose at either end, and as long
        # as the sine of that
        step = self._poses[start].inverse().then(last)
        share = (time - end) / (end - self._times[start])
        half = 0.5 * float(np.linalg.norm(step.rotation))
        length = share if half < _STRAIGHT else sin(share * half) / sin(half)
        chord = so3.rotate(0.5 * (share - 1.0) * step.rotation, step.translation)
        return last.then(Placement(length * chord, share * step.rotation))


class FrameHistory:
    """The placements of ``frame`` in ``base``, by the transforms of other nodes between them.

    Each has its stamps, between which it is interpolated, as tf2 does.
    """

    def __init__(self, base: str, frame: str) -> None:
        self._base, self._frame = base, frame
        #: The last transform to each frame from its parent, and whether it is static.
        self._links: dict[str, tuple[StampedTransform, bool]] = {}
        #: Frames from ``frame`` upwards, and their placements over time, or at any time.
        self._way = {frame}
        self._histories: dict[str, PoseHistory] = {}
        self._static: dict[str, Placement] = {}

    def add(self, transforms: Iterable[StampedTransform], *, static: bool) -> None:
        """Add the transforms of a message, but those that are none."""
        for transform in transforms:
            child = transform.child
            known = child in self._links or len(self._links) < _MOST_FRAMES
            if not known or not transform.is_rigid:
                continue
            before = self._links.get(child)
            if before is not None and before[0].parent != transform.parent:
                self._histories.pop(child, None)
            self._links[child] = transform, static
            if child in self._way:
                self._keep(child)
                self._extend(transform.parent)

    def _extend(self, frame: str) -> None:
        """Note that a frame, and those above it that are known, are on the way."""
        while frame != self._base and frame not in self._way:
            self._way.add(frame)
            if frame not in self._links:
                return
            self._keep(frame)
            frame = self._links[frame][0].parent

    def _keep(self, child: str) -> None:
        """Note where the last transform places a frame on the way."""
        transform, static = self._links[child]
        placement = placement_of(transform)
        if static:
            self._static[child] = placement
            self._histories.pop(child, None)
        else:
            self._static.pop(child, None)
            self._histories.setdefault(child, PoseHistory()).add(transform.time, placement)

    def at(self, time: int, tolerance: float) -> Placement | None:
        """Return the placement at ``time``, where each transform is known as in `PoseHistory`."""
        placement, frame, passed = Placement(np.zeros(3), np.zeros(3)), self._frame, 0
        while frame != self._base:
            if frame not in self._links or passed == len(self._way):
                return None
            outer = self._static.get(frame)
            if outer is None and frame in self._histories:
                outer = self._histories[frame].at(time, tolerance)
            if outer is None:
                return None
            placement, frame = outer.then(placement), self._links[frame][0].parent
            passed += 1
        return placement
