# SPDX-License-Identifier: Apache-2.0
"""Three bare rclpy processes that pass messages round: what the transport alone costs.

The same message types as the loop (a velocity, an odometry, a wrench), the same executor,
messages reused in place, and no mathematics. Run as a program this is one of the two relays.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future

from kalman_ros.nodes.runtime import main as run_node
from kalman_ros.nodes.topics import QUEUE

from .domain import Domain
from .interrupts import deferred
from .process import NodeProcess, isolated

HOPS: list[tuple[Any, str]] = [
    (TwistWithCovarianceStamped, 'ring_velocity'),
    (Odometry, 'ring_estimate'),
    (WrenchStamped, 'ring_force'),
]


def relay(number: int) -> Any:
    """Return the node that answers each message of hop ``number`` with one of the next."""
    node = rclpy.create_node(f'relay{number}')
    (heard, source), (said, target) = HOPS[number], HOPS[number + 1]
    publisher, message = node.create_publisher(said, target, QUEUE), said()

    def answer(received: Any) -> None:
        message.header.stamp = received.header.stamp
        publisher.publish(message)

    node.create_subscription(heard, source, answer, QUEUE)
    return node


class Ring:
    """The ring, with this process as its third member; use as a context manager."""

    def __enter__(self) -> Ring:
        self._domain = Domain()
        self._folder = tempfile.TemporaryDirectory(prefix='kalman_ros_ring_')
        environment = isolated(self._domain.id)
        self._relays = [
            NodeProcess(
                f'relay{number}',
                [sys.executable, '-m', 'kalman_ros.harness.ring', str(number)],
                environment,
                Path(self._folder.name) / f'relay{number}.log',
            )
            for number in range(2)
        ]
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=self._domain.id)
        self._node = rclpy.create_node('ring', context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        (first, source), (last, target) = HOPS[0], HOPS[-1]
        self._message = first()
        self._publisher = self._node.create_publisher(first, source, QUEUE)
        self._subscription = self._node.create_subscription(last, target, self._came, QUEUE)
        self._left = 0
        self._done = Future()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in self._relays:
            process.stop()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
        self._folder.cleanup()
        self._domain.close()

    def _came(self, _: Any) -> None:
        self._left -= 1
        if self._left > 0:
            self._publisher.publish(self._message)
        elif not self._done.done():
            self._done.set_result(None)

    def rounds(self, count: int) -> float:
        """Return the seconds that a message takes once round, averaged over ``count``.

        Raises
        ------
        RuntimeError
            If a message gets lost.
        """
        if not self._round(1, patience=1.0):
            for _ in range(20):  # the relays have just started; what is not heard is sent again
                if self._round(1, patience=1.0):
                    break
        start = time.perf_counter()
        if not self._round(count, patience=60.0):
            raise RuntimeError('the ring of bare nodes lost a message')
        return (time.perf_counter() - start) / count

    def _round(self, count: int, patience: float) -> bool:
        self._left, self._done = count, Future()
        self._publisher.publish(self._message)
        done = self._done
        with deferred(lambda: done.done() or done.set_result(None)):
            self._executor.spin_until_future_complete(done, patience)
        return bool(done.done())


if __name__ == '__main__':
    run_node(lambda: relay(int(sys.argv[1])))
