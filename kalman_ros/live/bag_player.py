# SPDX-License-Identifier: Apache-2.0
"""Playback of a recording to viewers, under the control of a viewer."""

from __future__ import annotations

import time
from math import isfinite
from threading import Condition
from typing import NamedTuple, Protocol

from kalman_ros.bags.definitions import definition
from kalman_ros.bags.reading import Bag

#: Intervals in seconds between two checks for a viewer, and between two reports of the time.
_LOOK, _REPORT = 0.1, 0.25
#: Range of the speed.
_SLOWEST, _FASTEST = 0.01, 100.0


class Position(NamedTuple):
    """The state of a player: time in nanoseconds, speed, and whether it plays or has ended."""

    time: int
    speed: float
    playing: bool
    ended: bool


class Screen(Protocol):
    """A receiver of the messages of a recording."""

    @property
    def wanted(self) -> set[str]:
        """Topics to which a viewer is subscribed."""
        ...

    def publish(self, topic: str, data: bytes, time: int) -> None:
        """Send a message with its time in nanoseconds."""
        ...

    def report(self, position: Position) -> None:
        """Show the position of the player."""
        ...


class BagPlayer:
    """A player that starts with the first viewer; viewers may pause, seek, or change the speed.

    Parameters
    ----------
    bag
        Recording to play.
    """

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        #: Type of each topic that can be played.
        self.topics: dict[str, str] = {}
        #: Reason for which each other topic cannot be played.
        self.refused: dict[str, str] = {}
        for topic, kinds in sorted(bag.topics.items()):
            kind, *others = sorted(kinds)
            if others:
                self.refused[topic] = f'it has several types: {", ".join(sorted(kinds))}'
            elif not definition(kind):
                self.refused[topic] = f'its type {kind} is not installed'
            else:
                self.topics[topic] = kind
        #: Start and end of the recording, in nanoseconds.
        self.period = bag.start, bag.end
        self._position = Position(bag.start, 1.0, playing=True, ended=False)
        self._changed = Condition()
        self._requests = 0

    def control(self, *, playing: bool, speed: float, seek: int | None) -> Position:
        """Carry out a request of a viewer, from any thread, and return the new position."""
        with self._changed:
            start, end = self.period
            current = self._position
            target = current.time if seek is None else min(max(seek, start), end)
            if seek is None and current.ended and playing:
                target = start
            if not (isfinite(speed) and speed > 0.0):
                speed = current.speed
            speed = min(max(speed, _SLOWEST), _FASTEST)
            self._position = Position(target, speed, playing, ended=False)
            self._requests += 1
            self._changed.notify_all()
            return self._position

    def run(self, screen: Screen) -> None:
        """Play until a signal ends the process."""
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
        """Play from a position until the next request; return whether the recording ended."""
        start, reported = time.monotonic(), 0.0
        for message in self._bag.messages(self.topics, position.time):
            due = start + (message.time - position.time) / 1e9 / position.speed
            while True:
                now = time.monotonic()
                with self._changed:
                    if self._requests != request:
                        return False
                    current = position.time + round(1e9 * (now - start) * position.speed)
                    current = min(current, message.time)
                    self._position = self._position._replace(time=current)
                    if now < due:
                        self._changed.wait(min(due - now, _REPORT))
                if now - reported >= _REPORT:
                    reported = now
                    screen.report(self._position)
                if now >= due:
                    break
            screen.publish(message.topic, message.data, message.time)
        return True
