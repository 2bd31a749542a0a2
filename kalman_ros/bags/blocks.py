# SPDX-License-Identifier: Apache-2.0
"""Messages in the order in which they were received, from parts of files that overlap in time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import islice
from math import inf
from operator import itemgetter
from typing import NamedTuple, Protocol

from .budget import MOST_PENDING, MOST_WAITING, Budget

#: Bytes that a message takes in memory beside its content, and messages that are counted at once.
_MESSAGE, _GROUP = 200, 4096
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


class Block(NamedTuple):
    """A part of a file: the times of its first and last message, in ns, and its reader."""

    start: int
    end: int
    read: Callable[[Collection[str], Budget], Iterable[Message]]


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
) -> Iterator[Message]:
    """Yield the messages of some topics, received from ``start`` to ``end``, in order.

    Messages with one time are in the order of the file.

    Raises
    ------
    ValueError
        If a block cannot be read, or the budget does not suffice.
    """
    selected = sorted((b for b in blocks if b.start <= end and b.end >= start), key=itemgetter(0))
    #: The time of the next message of each block, its place in the file, all, and its index.
    pending: list[tuple[int, int, list[Message], int]] = []
    time = itemgetter(0)
    for index, block in enumerate(selected):
        messages = sorted(_collect(block.read(topics, budget), budget), key=time)
        if messages and not block.start <= messages[0].time <= messages[-1].time <= block.end:
            raise ValueError('a message was not received when the part that it is in says')
        if messages:
            heappush(pending, (messages[0].time, index, messages, 0))
        until = selected[index + 1].start if index + 1 < len(selected) else inf
        while pending and pending[0][0] < until:
            _, number, messages, at = heappop(pending)
            most = bisect_left(messages, until, at, key=time)
            if pending:
                other, behind, *_ = pending[0]
                bisect = bisect_right if number < behind else bisect_left
                most = bisect(messages, other, at, most, key=time)
            if most < len(messages):
                heappush(pending, (messages[most].time, number, messages, most))
            begin = bisect_left(messages, start, at, most, key=time)
            stop = bisect_right(messages, end, begin, most, key=time)
            yield from messages[begin:stop]
            budget.release(_size(messages[at:most]))


def _collect(messages: Iterable[Message], budget: Budget) -> list[Message]:
    """Return messages as a list; raise ValueError if the budget does not suffice."""
    iterator = iter(messages)
    collected: list[Message] = []
    while group := list(islice(iterator, _GROUP)):
        budget.work(len(group))
        budget.hold(_size(group))
        collected += group
    return collected


def _size(messages: Iterable[Message]) -> int:
    """Return the bytes that messages take in memory."""
    return sum(len(message.data) + _MESSAGE for message in messages)


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
