# SPDX-License-Identifier: Apache-2.0
"""Places of sensors on the body, by the transforms on ``/tf_static``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from kalman_ros.core import Signal
from kalman_ros.core import rotations as so3
from kalman_ros.core.mount import mounting
from kalman_ros.scenario import Scenario, SensorSource
from kalman_ros.scenario.building import placed

from .frames import STATIC, Frames, Placement


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
        self._frames = Frames()
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
        return any(signal.mounting.from_tf for signal in (*signals, self._scenario.input))

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
        self._mounted[name] = frame or self._base, placement
        if not frame:
            self._warn(f"{name}: the messages name no frame: taken to be '{self._base}'")
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
        mount = mount._replace(scale=reported.scale)
        self._input = frame or self._base, placement
        return replace(signal, mounting=mount)

    def _known(self, frame: str) -> Placement:
        """Return the placement of a frame; ValueError if it is not known."""
        frame = frame or self._base
        placement = self._frames.placement(frame, self._base)
        if placement is None and frame in self._frames.refused:
            raise ValueError(
                f"the transform of '{frame}' on {STATIC} is not finite, or no rotation"
            )
        if placement is None:
            raise ValueError(f"no transform from '{self._base}' to '{frame}' on {STATIC} yet")
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
