# SPDX-License-Identifier: Apache-2.0
"""Three bare rclpy processes that pass messages round: the cost of the transport alone.

The same message types as the loop (a velocity, an odometry, a wrench), the same executor,
messages
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from tools.paths import with_tools

from kalman_ros.harness.isolated_context import IsolatedContext
from kalman_ros.harness.process import NodeProcess
from kalman_ros.nodes.middleware.interruption import Interruption
from kalman_ros.nodes.middleware.topics import QUEUE
from kalman_ros.nodes.middleware.transport import prefer_sockets

#: The most seconds that a ring runs.
_LONGEST = 3600.0
HOPS: list[tuple[Any, str]] = [
    (TwistWithCovarianceStamped, 'ring_velocity'),
    (Odometry, 'ring_estimate'),
    (WrenchStamped, 'ring_force'),
]


def relay(number: int) -> Any:
    """Return the node that answers each message of hop ``number`` with one of the next."""
    node = rclpy.create_node(f'relay{number}')
    (incoming, source), (outgoing, target) = HOPS[number], HOPS[number + 1]
    publisher, message = node.create_publisher(outgoing, target, QUEUE), outgoing()

    def answer(received: Any) -> None:
        message.header.stamp = received.header.stamp
        publisher.publish(message)

    node.create_subscription(incoming, source, answer, QUEUE)
    return node


def start_relay(number: int, context: IsolatedContext, folder: str) -> NodeProcess:
    """Start the relay of hop ``number`` as a process; its output goes to the ``folder``."""
    command = [sys.executable, '-m', __spec__.name, str(number)]
    log = Path(folder) / f'relay{number}.log'
    return NodeProcess(f'relay{number}', command, with_tools(context.environment), log)


class Ring:
    """The ring, with this process as its third member; use as a context manager."""

    def __enter__(self) -> Ring:
        self._context = IsolatedContext('ring')
        self._folder = tempfile.TemporaryDirectory(prefix='kalman_ros_ring_')
        self._relays = [start_relay(number, self._context, self._folder.name) for number in (0, 1)]
        node = self._context.node
        (first, source), (last, target) = HOPS[0], HOPS[-1]
        self._message = first()
        self._publisher = node.create_publisher(first, source, QUEUE)
        self._subscription = node.create_subscription(last, target, self._came, QUEUE)
        self._left = 0
        self._done = Future()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._relays:
            process.stop()
        self._context.close()
        self._folder.cleanup()

    def _came(self, _: Any) -> None:
        self._left -= 1
        if self._left > 0:
            self._publisher.publish(self._message)
        elif not self._done.done():
            self._done.set_result(None)

    def rounds(self, count: int) -> float:
        """Return the seconds of a message once round, averaged over ``count``.

        Raises
        ------
        RuntimeError
            If a message gets lost.
        """
        if not self._round(1, patience=1.0):
            for _ in range(20):  # repeat until the new relays are connected
                if self._round(1, patience=1.0):
                    break
        start = time.perf_counter()
        if not self._round(count, patience=60.0):
            raise RuntimeError('the ring of bare nodes lost a message')
        return (time.perf_counter() - start) / count

    def _round(self, count: int, patience: float) -> bool:
        self._left, self._done = count, Future()
        self._publisher.publish(self._message)
        return self._context.spin(patience, self._done)


def _run(number: int) -> None:
    """Run a relay until a signal asks for the end."""
    interruption = Interruption()
    interruption.defer()
    prefer_sockets()
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    executor.add_node(relay(number))
    executor.spin_until_future_complete(interruption.asked, _LONGEST)
    executor.shutdown()
    rclpy.try_shutdown()


if __name__ == '__main__':
    _run(int(sys.argv.pop()))  # the others are for ROS
