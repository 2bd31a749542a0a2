# SPDX-License-Identifier: Apache-2.0
"""Topics that are read now and then, all that has come at once, instead of message by message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile


def waiting(subscription: Any) -> list[bytes]:
    """Return what has come of a subscription and nobody has been given yet."""
    take, kind = subscription.handle.take_message, subscription.msg_type
    come: list[bytes] = []
    # no more than its queue holds, for more may come meanwhile, and never end
    for _ in range(subscription.qos_profile.depth):
        found = take(kind, True)
        if found is None:
            break
        come.append(found[0])
    return come


class WatcherNode(Node):  # type: ignore[misc]
    """A node that wakes for time, not for messages, on the topics that it watches.

    Who only gathers is in no hurry, and what a message costs is mostly the waking for it.
    The queues must be deep enough for what comes between two looks.
    """

    #: The subscriptions that no executor is to wake for.
    watched: tuple[Any, ...] = ()

    @property
    def subscriptions(self) -> Iterator[Any]:
        """The subscriptions that an executor is to wake for."""
        return (found for found in super().subscriptions if found not in self.watched)

    def watch(
        self, kind: Any, topic: str, take: Callable[[bytes], None], queue: QoSProfile
    ) -> Any:
        """Subscribe to the serialised messages of a topic, for `look` to read."""
        found = self.create_subscription(kind, topic, take, queue, raw=True)
        self.watched = (*self.watched, found)
        return found

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription, whether it is watched or not."""
        self.watched = tuple(found for found in self.watched if found is not subscription)
        return bool(super().destroy_subscription(subscription))

    def look(self) -> None:
        """Give all that has come since the last time to those who take it, topic by topic."""
        for subscription in self.watched:
            for data in waiting(subscription):
                subscription.callback(data)

    def look_every(self, seconds: float) -> None:
        """Look again and again."""
        self.create_timer(seconds, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))
