# SPDX-License-Identifier: Apache-2.0
"""The bond of a node with the manager that activates it, such as Nav2's lifecycle manager.

Both publish ``bond/msg/Status`` on ``bond`` with one ``id``, the node's name, and each with an
``instance_id`` of its side. A side that is silent for a while is gone.
The protocol is that of ROS's package ``bond``, which is needed for its message alone.
"""

from __future__ import annotations

from os import urandom
from time import monotonic
from typing import Any

from kalman_ros.codecs.messages import message_type
from kalman_ros.pipeline.throttle import Throttle

from .host import Host

TYPE, TOPIC = 'bond/Status', 'bond'
#: Seconds between two messages, and after which the other side gives up: Nav2's defaults.
PERIOD, TIMEOUT = 0.25, 4.0
#: A manager that gives up sooner is not silent for that.
_SOONEST = 1.0


def has_type() -> bool:
    """Return whether the message of bonds is installed."""
    try:
        message_type(TYPE)
    except ValueError:
        return False
    return True


class Bond:
    """Says that a node is active, until it is not, and notices when its manager is gone.

    The node goes on without its manager: what it estimates or regulates still moves.

    Parameters
    ----------
    node
        The node, which is being activated.
    name
        Its name, which is the ``id`` of the bond.
    """

    def __init__(self, node: Host, name: str) -> None:
        self._warn = Throttle(node.get_logger().warning)
        kind = message_type(TYPE)
        self._message = kind(id=name, instance_id=urandom(16).hex(), active=True)
        self._message.heartbeat_period, self._message.heartbeat_timeout = PERIOD, TIMEOUT
        self._node = node
        #: The side of the manager, when its last message came, and for how long it may be silent.
        self._other, self._last, self._patience = '', 0.0, TIMEOUT
        self._broken = False
        self._publisher = node.create_publisher(kind, TOPIC, 5)
        node.create_subscription(kind, TOPIC, self.receive, 100)
        node.create_timer(PERIOD, self.beat, clock=node.steady)
        node.at_the_end(self.part)

    def beat(self) -> None:
        """Publish that the node is active, and look whether the manager is still there."""
        if self._broken:
            return
        self._publish()
        if self._other and monotonic() - self._last > self._patience:
            self._warn(f'the manager is silent for {self._patience:g} s: going on alone')
            self._other = ''

    def receive(self, message: Any) -> None:
        """Take a message of the manager; those of others, and of a second manager, are ignored."""
        mine = self._message
        if message.id != mine.id or message.instance_id in ('', mine.instance_id):
            return
        if not self._other and message.active:
            self._other, self._broken = message.instance_id, False
        if message.instance_id != self._other:
            return
        self._last = monotonic()
        if 0.0 < message.heartbeat_timeout < 3600.0:
            self._patience = max(message.heartbeat_timeout, _SOONEST)
        if not message.active:
            self._broken, self._other = True, ''
            self._publish()

    def part(self) -> None:
        """Publish that the node is not active any more."""
        self._broken = True
        self._publish()

    def _publish(self) -> None:
        self._message.active = not self._broken
        self._message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self._message)
