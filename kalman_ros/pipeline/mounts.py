# SPDX-License-Identifier: Apache-2.0
"""Places of sensors on the body, by the transforms on ``/tf_static``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kalman_ros.codecs.transform_list import transforms_in
from kalman_ros.core import Array, Signal, is_finite
from kalman_ros.core import rotations as so3
from kalman_ros.core.mount import mounting
from kalman_ros.scenario import Scenario, SensorSource
from kalman_ros.scenario.building import placed

TOPIC = '/tf_static'
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


class StaticFrames:
    """The placements of frames in their parents, and in each other."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Placement]] = {}
        #: Frames whose last transform cannot be used.
        self.refused: set[str] = set()

    def add(self, data: bytes) -> None:
        """Add the transforms in a message, except any that is not finite or not a rotation.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        """
        for transform in transforms_in(data):
            place, q = np.array(transform.translation), np.array(transform.quaternion)
            known = transform.child in self._parents or len(self._parents) < _MOST_FRAMES
            good = is_finite(place) and is_finite(q) and q.any()
            if not good and len(self.refused) < _MOST_FRAMES:
                self.refused.add(transform.child)
            if known and good:
                self.refused.discard(transform.child)
                rotation = so3.from_quaternion(q / np.abs(q).max())
                self._parents[transform.child] = transform.parent, Placement(place, rotation)

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


class Mounts:
    """Mounting of the sensors that take their place from ``/tf_static``.

    Until the transform of its frame is received, a sensor has no readings. The first transform
    counts: the mounting of a sensor is fixed.

    Parameters
    ----------
    scenario
        Scenario of the estimator.
    base
        Frame of the body.
    warn
        Function that is called with one line about a transform that changes.
    """

    def __init__(self, scenario: Scenario, base: str, warn: Callable[[str], object]) -> None:
        self._scenario, self._base, self._warn = scenario, base, warn
        self._frames = StaticFrames()
        #: Frame and placement of each sensor that is mounted.
        self._mounted: dict[str, tuple[str, Placement]] = {}
        #: Frame and placement of the input, if it is mounted.
        self._input: tuple[str, Placement] | None = None
        #: Sensors whose transform has changed since the mounting, which is logged once.
        self._changed: set[str] = set()
        #: Called with the scenario whenever a sensor is mounted.
        self.on_mounted: Callable[[Scenario], object] = id

    @property
    def needed(self) -> bool:
        """Whether any sensor, or the input, takes its place from transforms."""
        signals = [source.signal for source in self._scenario.sensors.values()]
        return any(each.mounting.from_tf for each in (*signals, self._scenario.input))

    def on_static(self, data: bytes) -> None:
        """Take a message of ``/tf_static``; UndecodableError if it is not one."""
        self._frames.add(data)
        placed = {**self._mounted, **({'input': self._input} if self._input else {})}
        for name, (frame, before) in placed.items():
            now = self._frames.placement(frame, self._base) or before
            if name not in self._changed and now.differs_from(before):
                self._changed.add(name)
                self._warn(f'{name}: the transform of {frame} has changed: restart the estimator')

    def configure(self, scenario: Scenario) -> None:
        """Mount sensors of a scenario that was changed live; its names are the same."""
        self._scenario = scenario

    def mount(self, name: str, frame: str) -> SensorSource:
        """Return a sensor with its mounting by the frame of its messages.

        Raises
        ------
        ValueError
            If the place is not known, or the model cannot use it; one line gives the reason.
        """
        placement = self._known(frame)
        source = self._placed(name, self._scenario.sensors[name], frame, placement)
        self._mounted[name] = frame, placement
        self.on_mounted(self.applied(self._scenario))
        return source

    def mount_input(self, frame: str) -> Signal:
        """Return the signal of the input, with its mounting by the frame of its messages.

        Raises
        ------
        ValueError
            If the place is not known; one line gives the reason.
        """
        placement, signal = self._known(frame), self._scenario.input
        angles, reported = so3.to_euler(placement.rotation).tolist(), signal.mounting
        place = placement.translation.tolist()
        mount = mounting(angles, reported.convention, frame, place).at(place)
        self._input = frame, placement
        return replace(signal, mounting=mount)

    def _known(self, frame: str) -> Placement:
        """Return the placement of a frame; ValueError if it is not known."""
        if not frame:
            raise ValueError('mount.tf: the messages name no frame')
        placement = self._frames.placement(frame, self._base)
        if placement is None and frame in self._frames.refused:
            raise ValueError(
                f"the transform of '{frame}' on {TOPIC} is not finite, or no rotation"
            )
        if placement is None:
            raise ValueError(f"no transform from '{self._base}' to '{frame}' on {TOPIC} yet")
        return placement

    def applied(self, scenario: Scenario) -> Scenario:
        """Return a scenario with the sensors that are mounted."""
        sources = dict(scenario.sensors)
        for name, (frame, placement) in self._mounted.items():
            sources[name] = self._placed(name, sources[name], frame, placement)
        return replace(scenario, sensors=sources) if self._mounted else scenario

    def _placed(
        self, name: str, source: SensorSource, frame: str, placement: Placement
    ) -> SensorSource:
        scenario = self._scenario
        angles = so3.to_euler(placement.rotation)
        return placed(name, source, scenario.state, frame, placement.translation, angles)
