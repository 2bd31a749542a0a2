# SPDX-License-Identifier: Apache-2.0
"""Lockstep as the estimator sees it: wait until all of a step has come, then take it in order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple


class Turn(NamedTuple):
    """Everything of one step: the input before it, and its readings in the order of the tick."""

    time: int
    input: tuple[int, Any] | None
    readings: list[tuple[str, Any]]


class Turns:
    """Puts together ticks, readings and inputs, which arrive in any order.

    A turn is complete when every reading that its tick names has come, and the input that
    answers the tick before it. A tick that is repeated makes a turn without readings; one that
    is earlier than the last starts anew, for then the plant was restarted.

    Parameters
    ----------
    names
        The sensor behind each topic; topics that are not listened to are not waited for.
    """

    def __init__(self, names: dict[str, str]) -> None:
        self._names = names
        self._ticks: dict[int, list[str]] = {}
        self._readings: dict[tuple[str, int], Any] = {}
        self._inputs: dict[int, Any] = {}
        self._last: int | None = None

    def reading(self, name: str, time: int, reading: Any) -> None:
        """Take in a reading."""
        self._readings[name, time] = reading

    def input(self, time: int, value: Any) -> None:
        """Take in the input that answers the step at ``time``."""
        self._inputs[time] = value

    def tick(self, time: int, source: str) -> bool:
        """Take in a tick, whose ``source`` has the topics of its readings, comma separated.

        Returns whether time went back.
        """
        topics = [topic for topic in source.split(',') if topic]
        self._ticks[time] = [self._names[topic] for topic in topics if topic in self._names]
        if self._last is None or time >= self._last:
            return False
        self._last = None
        self._inputs.clear()
        return True

    def complete(self) -> Iterator[Turn]:
        """Yield the turns that are complete by now, in order."""
        while self._ticks:
            time, last = min(self._ticks), self._last
            names = self._ticks[time] if time != last else []
            if any((name, time) not in self._readings for name in names):
                return
            if last is not None and time != last and last not in self._inputs:
                return
            input = (last, self._inputs[last]) if last is not None and time != last else None
            readings = [(name, self._readings[name, time]) for name in names]
            self._last = time
            del self._ticks[time]
            self._readings = {key: r for key, r in self._readings.items() if key[1] > time}
            self._inputs = {stamp: u for stamp, u in self._inputs.items() if stamp >= time}
            yield Turn(time, input, readings)
