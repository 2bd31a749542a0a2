# SPDX-License-Identifier: Apache-2.0
"""Topics that are read in batches, now and then, instead of message by message."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from typing import Any

from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from kalman_ros.codecs.messages import UndecodableError, decode
from kalman_ros.pipeline.intake import Intake

from . import private
from .losses import Losses
from .one_line_logger import OneLineLogger
from .reception import ReceptionTimes

#: At most this many bytes are read at once, plus the message that exceeds them.
_MOST_BYTES = 16_000_000


def _decoded(callback: Callable[[Any], None], kind: Any, data: bytes) -> None:
    """Call back with the message of type ``kind`` in ``data``; UndecodableError if it is invalid.

    rclpy raises on a clock before 1970.
    """
    message = decode(data, kind)
    if kind is Clock and message.clock.sec < 0:
        raise UndecodableError(f'{message.clock.sec} s is no time')
    callback(message)


def waiting(subscription: Any, first: Sequence[bytes] = ()) -> list[bytes]:
    """Return the messages waiting in a subscription, after the ``first`` ones, handed over."""
    come = waiting_with_times(subscription)
    return [*first, *(data for data, _ in come)] if come else [*first]


def waiting_with_times(subscription: Any) -> list[tuple[bytes, tuple[int, int]]]:
    """Return the same with when each was received and when published, in nanoseconds."""
    come: list[tuple[bytes, tuple[int, int]]] = []
    size = 0
    # at most the depth of its queue, since more may arrive meanwhile, without end
    for _ in range(subscription.qos_profile.depth):
        message = private.take(subscription)
        if message is None:
            break
        data, info = message
        subscription.losses.numbered(info['publication_sequence_number'])
        received = subscription.received(info['received_timestamp'])
        come.append((data, (received, info['source_timestamp'])))
        size += len(data)
        if size > _MOST_BYTES:
            break
    return come


class WatcherNode(Node):  # type: ignore[misc]
    """A node that reads watched topics on a timer instead of waking for each message.

    The cost of a message is mostly the wake-up, and a recorder is in no hurry.
    Queues must be deep enough for the messages between two reads.

    Every subscription passes through its `intake`: the middleware delivers bytes, and
    invalid messages are dropped here.
    """

    #: When the message that is being passed on was received and published, in nanoseconds.
    times = 0, 0
    #: The subscriptions for which the executor does not wake.
    watched: tuple[Any, ...] = ()

    def get_logger(self) -> OneLineLogger:
        """Return the log of the node; what messages contain cannot control a terminal."""
        return self._one_line_logger

    @cached_property
    def _one_line_logger(self) -> OneLineLogger:
        return OneLineLogger(super().get_logger().name)

    @cached_property
    def intake(self) -> Intake:
        """Drops unreadable messages of every subscription."""
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
        """Subscribe; undecodable messages do not reach the callback.

        With ``raw``, the callback decodes, through `decode`, and its UndecodableError drops the
        message.
        """
        take = callback if raw else partial(_decoded, callback, kind)
        # rclpy itself would decode where its exceptions cannot be caught
        subscription = super().create_subscription(kind, topic, take, queue, raw=True, **options)
        subscription.losses, subscription.received = Losses(subscription), ReceptionTimes()
        subscription.pass_on = partial(self.intake.read, subscription.topic_name, take)
        private.pass_on_with_number(subscription, subscription.losses.numbered)
        return subscription

    def subscribe_in_batches(
        self, kind: Any, topic: str, callback: Callable[[bytes], None], queue: Any
    ) -> Any:
        """Subscribe; the callback gets a message as it came, and others by `waiting`.

        The callback passes them through the intake itself.
        """
        subscription = self.create_subscription(kind, topic, callback, queue, raw=True)
        subscription.pass_on = callback
        return subscription

    def account(self) -> dict[str, Any]:
        """Return the counts of messages that did not reach a callback, by reason and topic."""
        account = self.intake.report()
        for subscription in (*self.subscriptions, *self.watched):
            if subscription.losses.count:
                key = f'lost by the middleware: {subscription.topic_name}'
                account[key] = account.get(key, 0) + subscription.losses.count
        return account

    @property
    def subscriptions(self) -> Iterator[Any]:
        """The subscriptions for which the executor wakes."""
        return (
            subscription
            for subscription in super().subscriptions
            if subscription not in self.watched
        )

    def watch(
        self, kind: Any, topic: str, take: Callable[[bytes], None], queue: QoSProfile
    ) -> Any:
        """Subscribe to the serialised messages of a topic, read by `look`."""
        subscription = self.create_subscription(kind, topic, take, queue, raw=True)
        self.watched = (*self.watched, subscription)
        return subscription

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription, watched or not."""
        subscription.losses.close()
        self.watched = tuple(other for other in self.watched if other is not subscription)
        return bool(super().destroy_subscription(subscription))

    def look(self) -> None:
        """Pass all messages received since the last call to their readers, topic by topic."""
        for subscription in self.watched:
            for data, self.times in waiting_with_times(subscription):
                subscription.pass_on(data)

    def look_every(self, seconds: float) -> None:
        """Call `look` periodically."""
        self.create_timer(seconds, self.look, clock=RosClock(clock_type=ClockType.STEADY_TIME))
