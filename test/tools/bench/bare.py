# SPDX-License-Identifier: Apache-2.0
"""A bare rclpy node that answers every message of some topics with an empty estimate.

Its arguments are the type of the estimate, and TOPIC=TYPE of each topic; those after a dash are
taken in and not answered. A separate program, which imports only what such a node needs.
"""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from typing import Any

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future


def message_type(name: str) -> Any:
    """Return the class of ``package/Name``."""
    package, _, kind = name.partition('/')
    return getattr(import_module(f'{package}.msg'), kind)


def main() -> None:
    """Relay until a signal arrives."""
    stop = Future()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set_result(None))
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node('bare')
    answer_type, *topics = sys.argv[1:]
    estimate = message_type(answer_type)()
    publisher = node.create_publisher(type(estimate), 'estimate', 50)

    def answer(message: Any) -> None:
        estimate.header.stamp = message.header.stamp
        publisher.publish(estimate)

    def take(message: Any) -> None:
        pass

    answered = topics.index('-') if '-' in topics else len(topics)
    for place, topic in enumerate(topics):
        name, _, kind = topic.partition('=')
        if kind:
            callback = answer if place < answered else take
            node.create_subscription(message_type(kind), name, callback, 50)
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.done():
        executor.spin_until_future_complete(stop, 1.0)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
