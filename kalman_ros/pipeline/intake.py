# SPDX-License-Identifier: Apache-2.0
"""The filter between topics and callbacks: no message can stop or block a node."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Any, Optional, TypeVar

from kalman_ros.codecs.messages import UndecodableError

#: Longest accepted message, in bytes, by default.
LONGEST = 1_000_000
#: Seconds between two warnings.
_PAUSE = 1.0

T = TypeVar('T')


class Intake:
    """Filter that drops messages that cannot be decoded or are too long, counts them, and warns.

    Parameters
    ----------
    warn
        Function that is called with one line, at most once a second.
    """

    def __init__(self, warn: Callable[[str], object]) -> None:
        self._warn = warn
        self._warned = -_PAUSE
        #: Longest accepted message, in bytes.
        self.longest = LONGEST
        self._dropped: Counter[tuple[str, str]] = Counter()
        self._sizes: dict[tuple[str, str], int] = {}

    def read(self, topic: str, read: Callable[[bytes], T], data: bytes) -> Optional[T]:
        """Return ``read`` of a message of ``topic``; None if the message is dropped."""
        if len(data) > self.longest:
            self._drop('too long', topic, data)
            return None
        try:
            return read(data)
        except UndecodableError:
            self.drop_undecodable(topic, data)
            return None

    def drop_undecodable(self, topic: str, data: bytes) -> None:
        """Drop a message that is known to be undecodable."""
        self._drop('undecodable', topic, data)

    def newest(
        self, topic: str, read: Callable[[bytes], T], messages: Sequence[bytes]
    ) -> Optional[T]:
        """Return ``read`` of the last message that is not dropped."""
        for data in reversed(messages):
            result = self.read(topic, read, data)
            if result is not None:
                return result
        return None

    def _drop(self, why: str, topic: str, data: bytes) -> None:
        self._dropped[why, topic] += 1
        self._sizes[why, topic] = len(data)
        now = monotonic()
        if now - self._warned >= _PAUSE:
            self._warned = now
            number = self._dropped[why, topic]
            size = f'{len(data)} bytes'
            most = f' (max_message_size is {self.longest})' if why == 'too long' else ''
            self._warn(f'{topic}: dropped a message of {size}: {why}{most}; {number} so far')

    def dropped(self, topic: str) -> int:
        """Return the number of dropped messages of a topic, for any reason."""
        return sum(count for (_, name), count in self._dropped.items() if name == topic)

    def report(self) -> dict[str, Any]:
        """Return the counts of dropped messages, by reason and topic."""
        return {
            f'{why}: {topic}': f'{count}, the last of {self._sizes[why, topic]} bytes'
            for (why, topic), count in self._dropped.items()
        }
