# SPDX-License-Identifier: Apache-2.0
"""Topics that are read now and then, all that has come at once, instead of message by message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Any

from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from kalman_ros.codecs.messages import UndecodableError, decode

from .intake import Intake
from .losses import Losses

#: So many bytes are taken at once, or the next message that makes them more.
_MOST_BYTES = 16_000_000


def _decoded(callback: Callable[[Any], None], kind: Any, data: bytes) -> None:
    """Call back with the message of type ``kind`` in ``data``; UndecodableError if it is none.

    A clock before 1970 is none to rclpy, which raises where it takes it in.
    """
    message = decode(data, kind)
    if kind is Clock and message.clock.sec < 0:
        raise UndecodableError(f'{message.clock.sec} s is no time')
    callback(message)


def waiting(subscription: Any) -> list[bytes]:
    """Return what has come of a subscription and nobody has been given yet."""
    take, kind = subscription.handle.take_message, subscription.msg_type
    come: list[bytes] = []
    size = 0
    # no more than its queue holds, for more may come meanwhile, and never end
    for _ in range(subscription.qos_profile.depth):
        found = take(kind, True)
        if found is None:
            break
        data, info = found
        subscription.losses.numbered(info['publication_sequence_number'])
        come.append(data)
        size += len(data)
        if size > _MOST_BYTES:
            break
    return come


class WatcherNode(Node):  # type: ignore[misc]
    """A node that wakes for time, not for messages, on the topics that it watches.

    Who only gathers is in no hurry, and what a message costs is mostly the waking for it.
    The queues must be deep enough for what comes between two looks.

    Whatever it subscribes to passes through its `intake`: the middleware hands over bytes, and
    those that are no message of the topic's type are dropped here.
    """

    #: The subscriptions that no executor is to wake for.
    watched: tuple[Any, ...] = ()

    @cached_property
    def intake(self) -> Intake:
        """Drops what cannot be read, of every subscription."""
        return Intake(lambda text: self.get_logger().warning(text))

    def create_subscription(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        queue: Any,
        *,
        raw: bool = False,
        **options: Any,
    ) -> Any:
        """Subscribe; what cannot be decoded never comes as far as the callback.

        With ``raw``, the callback decodes, by way of `decode`, and its UndecodableError drops the
        message.
        """
        take = callback if raw else partial(_decoded, callback, kind)
        # rclpy itself would decode where nobody can catch what that raises
        found = super().create_subscription(kind, topic, take, queue, raw=True, **options)
        found.losses = Losses(found)
        found.pass_on = partial(self.intake, found.topic_name, take)

        def on_message(data: bytes) -> None:
            found.losses.unnumbered()
            found.pass_on(data)

        found.callback = on_message
        return found

    def account(self) -> dict[str, Any]:
        """Return how many messages never came as far as a callback, by reason and topic."""
        account = self.intake.report()
        for found in (*self.subscriptions, *self.watched):
            if found.losses.count:
                key = f'lost by the middleware: {found.topic_name}'
                account[key] = account.get(key, 0) + found.losses.count
        return account

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
        subscription.losses.close()
        self.watched = tuple(found for found in self.watched if found is not subscription)
        return bool(super().destroy_subscription(subscription))

    def look(self) -> None:
        """Give all that has come since the last time to those who take it, topic by topic."""
        for subscription in self.watched:
            for data in waiting(subscription):
                subscription.pass_on(data)

    def look_every(self, seconds: float) -> None:
        """Look again and again."""
        self.create_timer(seconds, self.look, clock=RosClock(clock_type=ClockType.STEADY_TIME))
