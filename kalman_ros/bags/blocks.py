# SPDX-License-Identifier: Apache-2.0
"""Messages in the order in which they were received, from parts of files that overlap in time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import islice
from math import inf
from operator import itemgetter
from typing import Any, NamedTuple, Protocol

from .budget import MOST_PENDING, MOST_WAITING, Budget

#: Bytes that a message takes in memory beside its content, and messages that are counted at once.
_MESSAGE, GROUP = 200, 4096
#: Longest time from publication to reception that is put in order, in nanoseconds.
_LATENCY = 2_000_000_000


class Message(NamedTuple):
    """A message: the time of reception, the topic, the CDR bytes, and the time of publication.

    Times are in nanoseconds; the last is None if the recording does not have it.
    """

    time: int
    topic: str
    data: bytes
    published: int | None = None


@dataclass(frozen=True)
class Messages:
    """Messages by columns, each as in `Message`.

    Many take a fraction of the time and of the memory that they take one by one.
    """

    time: list[int] = field(default_factory=list)
    topic: list[str] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)
    published: list[int | None] = field(default_factory=list)

    @classmethod
    def of(cls, messages: Iterable[Message]) -> Messages:
        """Return messages by columns."""
        return cls(*map(list, zip(*messages)))

    @property
    def columns(self) -> tuple[list[Any], ...]:
        """The columns in the order of the fields of a message."""
        return self.time, self.topic, self.data, self.published

    def __len__(self) -> int:
        return len(self.time)

    def __iter__(self) -> Iterator[Message]:
        return map(Message, *self.columns)

    def __getitem__(self, at: int) -> Message:
        return Message(*(column[at] for column in self.columns))

    @property
    def size(self) -> int:
        """Bytes that they take in memory."""
        return sum(map(len, self.data)) + _MESSAGE * len(self)

    def some(self, which: slice) -> Messages:
        """Return some of the messages, one behind the other."""
        return Messages(*(column[which] for column in self.columns))

    def chosen(self, which: Sequence[int]) -> Messages:
        """Return the messages at some places."""
        return Messages(*([column[at] for at in which] for column in self.columns))

    def on(self, topics: Collection[str]) -> Messages:
        """Return the messages of some topics."""
        return self.chosen([at for at, topic in enumerate(self.topic) if topic in topics])

    def by_time(self) -> Messages:
        """Return the messages in the order of reception; those of one time as they are."""
        if self.time == sorted(self.time):
            return self
        return self.chosen(sorted(range(len(self)), key=self.time.__getitem__))


def joined(parts: Sequence[Messages]) -> Messages:
    """Return the messages of all parts, one part behind the other."""
    if len(parts) == 1:
        return parts[0]
    whole = Messages()
    for part in parts:
        for column, more in zip(whole.columns, part.columns):
            column += more
    return whole


def grouped(messages: Iterable[Message]) -> Iterator[Messages]:
    """Yield messages in groups by columns."""
    iterator = iter(messages)
    while group := list(islice(iterator, GROUP)):
        yield Messages.of(group)


class Block(NamedTuple):
    """A part of a file: the times of its first and last message, in ns, and its reader."""

    start: int
    end: int
    read: Callable[[Collection[str], Budget], Iterable[Messages]]


class Source(Protocol):
    """A file of a recording.

    ``topics`` are the message types that each topic has been recorded with, ``blocks`` the parts
    of the file, and ``damage`` describes the part that cannot be read, if any.
    """

    topics: dict[str, set[str]]
    blocks: list[Block]
    damage: str


def in_order(
    blocks: Sequence[Block],
    topics: Collection[str],
    budget: Budget,
    start: float = -inf,
    end: float = inf,
) -> Iterator[Messages]:
    """Yield the messages of some topics, received from ``start`` to ``end``, in order.

    Messages with one time are in the order of the file.

    Raises
    ------
    ValueError
        If a block cannot be read, or the budget does not suffice.
    """
    selected = sorted((b for b in blocks if b.start <= end and b.end >= start), key=itemgetter(0))
    #: The time of the next message of each block, its place in the file, all, and its index.
    pending: list[tuple[int, int, Messages, int]] = []
    for index, block in enumerate(selected):
        messages = _collect(block.read(topics, budget), budget)
        times = messages.time
        if times and not block.start <= times[0] <= times[-1] <= block.end:
            raise ValueError('a message was not received when the part that it is in says')
        if times:
            heappush(pending, (times[0], index, messages, 0))
        until = selected[index + 1].start if index + 1 < len(selected) else inf
        due: list[tuple[int, Messages]] = []
        while pending and pending[0][0] < until:
            _, number, messages, at = heappop(pending)
            most = bisect_left(messages.time, until, at)
            due.append((number, messages.some(slice(at, most))))
            if most < len(messages):
                heappush(pending, (messages.time[most], number, messages, most))
        if due:
            together = joined([part for _, part in sorted(due, key=itemgetter(0))]).by_time()
            times = together.time
            yield together.some(slice(bisect_left(times, start), bisect_right(times, end)))
            budget.release(together.size)


def _collect(groups: Iterable[Messages], budget: Budget) -> Messages:
    """Return messages in order; raise ValueError if the budget does not suffice."""
    collected = []
    for group in groups:
        budget.work(len(group))
        budget.hold(group.size)
        collected.append(group)
    return joined(collected).by_time()


def as_published(messages: Iterable[Message]) -> Iterator[Message]:
    """Yield messages in the order in which they were published, not received.

    On one machine that is the order of cause and effect: a response may be received before the
    message that it responds to, from another process, but it is not published before.
    """
    heap: list[tuple[int, int, Message]] = []
    size = 0
    for number, message in enumerate(messages):
        published = message.time if message.published is None else message.published
        heappush(heap, (published, number, message))
        size += len(message.data)
        while heap and (
            heap[0][0] + _LATENCY < message.time or len(heap) > MOST_WAITING or size > MOST_PENDING
        ):
            first = heappop(heap)[2]
            size -= len(first.data)
            yield first
    while heap:
        yield heappop(heap)[2]
