# SPDX-License-Identifier: Apache-2.0
"""Private node of this process in a private ROS domain."""

from __future__ import annotations

import time

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.task import Future

from kalman_ros.nodes.middleware.watcher import WatcherNode

from .domain import Domain
from .interrupts import deferred
from .process import isolated

#: Interval in seconds of reads of the watched topics.
_PERIOD = 0.01
#: Longest delay of a signal, in seconds.
_PATIENCE = 0.1


class IsolatedContext:
    """A node with its executor, in a domain that no other program on this machine uses.

    Parameters
    ----------
    name
        Name of the node.
    sockets
        Whether the processes of the domain use only sockets, so that none waits for a process that
        was killed.
    """

    def __init__(self, name: str, *, sockets: bool = False) -> None:
        self._domain = Domain()
        #: Environment for other processes in the domain.
        self.environment = isolated(self._domain.id, sockets=sockets)
        self._context = rclpy.Context()
        # NAME:=VALUE in the arguments of this program is for the nodes, not a remap of this node
        rclpy.init(args=[], context=self._context, domain_id=self._domain.id)
        self.node = WatcherNode(name, context=self._context, start_parameter_services=False)
        self.node.look_every(_PERIOD)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)

    @property
    def domain(self) -> int:
        """Number of the domain."""
        return self._domain.id

    def spin(self, seconds: float, until: Future | None = None) -> bool:
        """Process messages for ``seconds``, or until a future is done; return whether it is done.

        A signal ends the processing, and is delivered afterwards.
        """
        done, end = until or Future(), time.monotonic() + seconds
        with deferred() as signals:
            while True:
                left = end - time.monotonic()
                self._executor.spin_until_future_complete(done, min(max(left, 0.0), _PATIENCE))
                if signals or done.done() or left <= _PATIENCE:
                    return bool(done.done())

    def close(self) -> None:
        """Destroy the node, and release the context and the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
        self._domain.close()
