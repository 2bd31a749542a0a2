# SPDX-License-Identifier: Apache-2.0
"""Lockstep for the estimator: collect the messages of a step, and process them in order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Set
from functools import lru_cache
from typing import Any, NamedTuple

from kalman_ros.codecs.tick import mentioned


class Step(NamedTuple):
    """A complete step: the input before it, and its readings in the order of the tick."""

    time: int
    input: tuple[int, Any] | None
    readings: list[tuple[str, Any]]
    #: The object kept with a tick by `StepAssembler.tick`.
    kept: Any = None


#: Time of a message without a stamp, before every other time.
_UNSTAMPED = -1
#: Nanoseconds after which a reading that no tick has named is dropped.
_FORGOTTEN = 60_000_000_000
#: Largest numbers of ticks that wait for readings, of readings that they name, and of readings
#: and inputs that wait for their tick. A plant has one step in progress, and sends no more.
_MOST_TICKS, _MOST_NAMED, _MOST_WAITING = 1000, 10_000, 10_000

#: The name of a sensor, and a stamp.
_Key = tuple[str, int]


class StepAssembler:
    """Assembly of steps from ticks, readings and inputs, which arrive in any order.

    A message without a stamp belongs to the first step that lacks it.

    A step is complete when every reading that its tick names is received, late ones included,
    and the input that responds to the tick before it. A repeated tick makes a step without
    readings; one that is earlier than the last is a reset: the plant was restarted.

    Each topic keeps its order, so when a reading named in a later tick is received, one of the
    same topic that an earlier tick names is lost: that tick, which no plant sent, is dropped,
    as it is when the plant asks again for a later step.

    Parameters
    ----------
    names
        Name of the sensor of each topic; other topics are ignored.
    answered
        Whether an input responds to each tick; False for a model without inputs.
    resolve
        Function that returns the full name of a topic, which several names may have.
    """

    def __init__(
        self, names: dict[str, str], *, answered: bool = True, resolve: Callable[[str], str] = str
    ) -> None:
        self._names = {**{resolve(topic): name for topic, name in names.items()}, **names}
        self._resolve = lru_cache(maxsize=256)(resolve)
        self._answered = answered
        self._ticks: dict[int, list[_Key]] = {}
        self._kept: dict[int, Any] = {}
        # messages without a stamp are at _UNSTAMPED, since one step is in progress at a time
        self._readings: dict[_Key, list[Any]] = {}
        self._waiting = 0
        self._inputs: dict[int, Any] = {}
        self._last: int | None = None
        # by the last step: messages repeated because the plant asked again are not new
        self._taken: Set[_Key] = frozenset()

    def reading(self, name: str, time: int | None, reading: Any) -> None:
        """Add a reading."""
        key = name, _UNSTAMPED if time is None else time
        if key not in self._taken:
            self._waiting += 1
            if self._waiting > _MOST_WAITING:  # the plant repeats what it did send
                self._readings.clear()
                self._waiting = 1
            self._readings.setdefault(key, []).append(reading)

    def input(self, time: int | None, value: Any) -> None:
        """Add the input that responds to the step at ``time``."""
        if len(self._inputs) >= _MOST_WAITING:
            self._inputs.clear()
        self._inputs[_UNSTAMPED if time is None else time] = value

    def tick(self, time: int, topics: Iterable[str], kept: Any = None) -> bool:
        """Add a tick with the topics of its readings; return whether time went back.

        The ``kept`` object is returned with its step.
        """
        mentions = [mentioned(topic, time) for topic in topics]
        named = [(self._sensor(topic), stamp) for topic, stamp in mentions]
        if time in self._ticks:
            self._give_up_before(time)
        self._ticks[time] = [(name, stamp) for name, stamp in named if name is not None]
        self._kept[time] = kept
        if len(self._ticks) > _MOST_TICKS or sum(map(len, self._ticks.values())) > _MOST_NAMED:
            for latest in sorted(self._ticks)[len(self._ticks) // 2 :]:
                self._drop(latest)
        if self._last is None or time >= self._last:
            return False
        self._last, self._taken = None, frozenset()
        self._inputs.clear()
        return True

    def _sensor(self, topic: str) -> str | None:
        if topic not in self._names:
            try:
                topic = self._resolve(topic)
            except (ValueError, RuntimeError):  # not a valid name of a topic
                return None
        return self._names.get(topic)

    def waits_for(self, time: int) -> bool:
        """Return whether a tick at ``time`` was received and its step is incomplete."""
        return time in self._ticks

    @property
    def unanswered(self) -> int | None:
        """The time of the last step, if only its input is missing."""
        if not self._ticks or not self._answered or self._last is None:
            return None
        time, last = min(self._ticks), self._last
        waits = time != last and self._input_at(last) is None
        return last if waits and self._named(self._ticks[time]) is not None else None

    def _input_at(self, time: int) -> Any:
        return self._inputs.get(time, self._inputs.get(_UNSTAMPED))

    def complete(self) -> Iterator[Step]:
        """Yield the steps that are complete, in order."""
        while self._ticks:
            time, last = min(self._ticks), self._last
            keys = self._ticks[time] if time != last else []
            readings = self._named(keys)
            if readings is None:
                if not self._is_lost(time):
                    return
                self._drop(time)
                continue
            input = None
            if self._answered and last is not None and time != last:
                value = self._input_at(last)
                if value is None:
                    return
                input = last, value
            self._last = time
            kept = self._drop(time)
            if keys:
                self._taken = set(keys)
            self._forget(time)
            self._inputs = {stamp: u for stamp, u in self._inputs.items() if stamp >= time}
            yield Step(time, input, readings, kept)

    def _give_up_before(self, time: int) -> None:
        """Drop earlier ticks that lack a reading: a plant that asks again has sent them all."""
        for earlier, keys in list(self._ticks.items()):
            if earlier < time and self._named(keys) is None:
                self._drop(earlier)

    def _drop(self, time: int) -> Any:
        """Remove the tick at ``time``, and return the object kept with it."""
        del self._ticks[time]
        return self._kept.pop(time)

    def _is_lost(self, time: int) -> bool:
        """Return whether a reading that the tick at ``time`` lacks is lost."""
        needed = Counter(self._ticks[time])
        lacking = {key[0] for key, count in needed.items() if len(self._received(key)) < count}
        return any(
            key[0] in lacking and key not in needed and key in self._readings
            for later, keys in self._ticks.items()
            if later > time
            for key in keys
        )

    def _received(self, key: _Key) -> list[Any]:
        """Return the received readings of a key; those without a stamp if there are no others."""
        return self._readings.get(key) or self._readings.get((key[0], _UNSTAMPED), [])

    def _named(self, keys: list[_Key]) -> list[tuple[str, Any]] | None:
        """Return the readings that a tick names, in its order; None if one is missing."""
        left = Counter(keys)
        if any(len(self._received(key)) < count for key, count in left.items()):
            return None
        readings: list[tuple[str, Any]] = []
        for key in keys:
            # the last one of repeated readings
            readings.append((key[0], self._received(key)[-left[key]]))
            left[key] -= 1
        return readings

    def _forget(self, time: int) -> None:
        """Drop the readings of the step at ``time``, and old ones that no tick has named."""
        oldest = max(time - _FORGOTTEN, _UNSTAMPED)
        self._readings = {
            key: readings
            for key, readings in self._readings.items()
            if key not in self._taken and key[1] > oldest
        }
        self._waiting = sum(map(len, self._readings.values()))
