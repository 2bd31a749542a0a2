# SPDX-License-Identifier: Apache-2.0
"""Messages in the order in which they were received, from parts of files that overlap in time."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from heapq import heappop, heappush
from math import inf
from operator import itemgetter
from typing import NamedTuple, Protocol

#: The most bytes that are held in memory until their order is known, and of one block.
MOST_PENDING, MOST_BLOCK = 1 << 30, 1 << 28
#: The most messages that wait for others.
MOST_WAITING = 50_000
#: The longest time from publication to reception that is put in order, in nanoseconds.
_LATENCY = 2_000_000_000


class Message(NamedTuple):
    """When it was received, its topic, its CDR bytes, and when it was published.

    Times are in nanoseconds; the last is None where the recording does not have it.
    """

    time: int
    topic: str
    data: bytes
    published: int | None = None


class Block(NamedTuple):
    """A part of a file: the times of its first and last message, in ns, and how to read it."""

    start: int
    end: int
    read: Callable[[Collection[str]], list[Message]]


class Source(Protocol):
    """A file of a recording.

    ``topics`` are the message types that each topic has been recorded with, ``blocks`` the parts
    of the file, and ``damage`` says in words what of it cannot be read, if anything.
    """

    topics: dict[str, set[str]]
    blocks: list[Block]
    damage: str


def in_order(
    blocks: Sequence[Block], topics: Collection[str], start: float = -inf, end: float = inf
) -> Iterator[Message]:
    """Yield the messages of some topics, received from ``start`` to ``end``, in order.

    Messages with one time are in the order of the file.

    Raises
    ------
    ValueError
        If a block cannot be read, or so much overlaps that it would fill the memory.
    """
    wanted = sorted((b for b in blocks if b.start <= end and b.end >= start), key=itemgetter(0))
    pending: list[Message] = []
    for index, block in enumerate(wanted):
        found = block.read(topics)
        if any(not block.start <= message.time <= block.end for message in found):
            raise ValueError('a message was not received when the part that it is in says')
        pending += found
        pending.sort(key=itemgetter(0))
        until = wanted[index + 1].start if index + 1 < len(wanted) else inf
        count = bisect_left(pending, until, key=itemgetter(0))
        for message in pending[:count]:
            if start <= message.time <= end:
                yield message
        del pending[:count]
        if sum(len(message.data) for message in pending) > MOST_PENDING:
            raise ValueError(f'more than {MOST_PENDING} bytes of messages are not in order')


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
