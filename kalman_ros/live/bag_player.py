# SPDX-License-Identifier: Apache-2.0
"""Plays a recording to viewers at the pace at which it was made, as a viewer requests."""

from __future__ import annotations

import time
from math import isfinite
from threading import Condition
from typing import NamedTuple, Protocol

from kalman_ros.bags.definitions import definition
from kalman_ros.bags.reading import Bag

#: Seconds between two looks for a viewer, and between two reports of the time.
_LOOK, _REPORT = 0.1, 0.25
#: The range of the speed.
_SLOWEST, _FASTEST = 0.01, 100.0


class Position(NamedTuple):
    """Where a player is: its time in nanoseconds, its speed, and whether it plays or has ended."""

    time: int
    speed: float
    playing: bool
    ended: bool


class Screen(Protocol):
    """What a recording is played to."""

    @property
    def wanted(self) -> set[str]:
        """The topics that a viewer is subscribed to."""
        ...

    def publish(self, topic: str, data: bytes, time: int) -> None:
        """Send a message."""
        ...

    def report(self, position: Position) -> None:
        """Show where the player is."""
        ...


class BagPlayer:
    """Plays from the first viewer on; a viewer may pause it, go elsewhere, or change the speed.

    Parameters
    ----------
    bag
        The recording.
    """

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        #: The type of each topic that can be played.
        self.topics: dict[str, str] = {}
        #: Why the others cannot be.
        self.refused: dict[str, str] = {}
        for topic, kinds in sorted(bag.topics.items()):
            kind, *others = sorted(kinds)
            if others:
                self.refused[topic] = f'it has several types: {", ".join(sorted(kinds))}'
            elif not definition(kind):
                self.refused[topic] = f'its type {kind} is not installed'
            else:
                self.topics[topic] = kind
        #: When the recording starts and ends, in nanoseconds.
        self.period = bag.start, bag.end
        self._position = Position(bag.start, 1.0, playing=True, ended=False)
        self._changed = Condition()
        self._requests = 0

    def control(self, *, playing: bool, speed: float, seek: int | None) -> Position:
        """Do what a viewer requests, and return the new position; any thread may call this."""
        with self._changed:
            start, end = self.period
            now = self._position
            at = now.time if seek is None else min(max(seek, start), end)
            if seek is None and now.ended and playing:
                at = start
            if not (isfinite(speed) and speed > 0.0):
                speed = now.speed
            speed = min(max(speed, _SLOWEST), _FASTEST)
            self._position = Position(at, speed, playing, ended=False)
            self._requests += 1
            self._changed.notify_all()
            return self._position

    def run(self, screen: Screen) -> None:
        """Play until a signal."""
        while not screen.wanted:
            time.sleep(_LOOK)
        while True:
            with self._changed:
                while not self._position.playing:
                    self._changed.wait(_LOOK)
                request, position = self._requests, self._position
            screen.report(position)
            if self._play(screen, request, position):
                with self._changed:
                    if self._requests == request:
                        end = self.period[1]
                        self._position = Position(end, position.speed, playing=False, ended=True)
                screen.report(self._position)

    def _play(self, screen: Screen, request: int, position: Position) -> bool:
        """Play from a position until a viewer requests something; return whether it ended."""
        begun, reported = time.monotonic(), 0.0
        for message in self._bag.messages(self.topics, position.time):
            due = begun + (message.time - position.time) / 1e9 / position.speed
            while True:
                now = time.monotonic()
                with self._changed:
                    if self._requests != request:
                        return False
                    reached = position.time + round(1e9 * (now - begun) * position.speed)
                    reached = min(reached, message.time)
                    self._position = self._position._replace(time=reached)
                    if now < due:
                        self._changed.wait(min(due - now, _REPORT))
                if now - reported >= _REPORT:
                    reported = now
                    screen.report(self._position)
                if now >= due:
                    break
            screen.publish(message.topic, message.data, message.time)
        return True
