# SPDX-License-Identifier: Apache-2.0
"""The status of a node on ``/diagnostics``, once a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from math import isnan
from typing import Any
from weakref import WeakKeyDictionary

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from kalman_ros.core.one_line import one_line

from .connections import Connections
from .host import Host
from .one_line_logger import LONGEST


class Level(Enum):
    """The status of a node."""

    OK = DiagnosticStatus.OK
    WARN = DiagnosticStatus.WARN
    ERROR = DiagnosticStatus.ERROR


SUBSCRIBERS = 'subscribers: '
PUBLISHERS = 'publishers: '
#: The number of earlier reports, which tells an old report from a new one.
NUMBER = 'reports'

#: A level, a sentence, and the values behind it.
Report = tuple[Level, str, Mapping[str, Any]]


#: How often connections are checked, and after how many checks a report is due.
_LOOK = 0.1
_LOOKS = 10
_EXCLUDED = ('/rosout', '/parameter_events', '/diagnostics')


class Diagnostics:
    """Publishes the result of ``report`` every second, on request, and on new connections.

    It adds the number of earlier reports, ``reports``, of subscribers of each of the node's
    topics, ``subscribers: TOPIC``, of publishers of each topic that it subscribes to,
    ``publishers: TOPIC``, and of messages that did not reach the node, ``undecodable: TOPIC``,
    ``too long: TOPIC`` and ``lost by the middleware: TOPIC``. A topic without publishers, or with
    another type or quality of service, is a warning. A value that is NaN is left out.
    """

    def __init__(self, node: Host, report: Callable[[], Report]) -> None:
        self._node: Any = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        #: The subscriptions of the node that receive nothing.
        self.connections = Connections(node)
        self._connections: dict[str, int] = {}
        self._keys: WeakKeyDictionary[Any, str] = WeakKeyDictionary()
        self._looks = 0
        self._timer = node.create_timer(_LOOK, self._look, clock=node.steady)

    def _look(self) -> None:
        self.connections.look()
        connections = self._count_connections()
        self._looks += 1
        if connections != self._connections or self._looks >= _LOOKS:
            self._connections = connections
            self.publish()

    def _count_connections(self) -> dict[str, int]:
        counts = {}
        for publisher in self._node.publishers:
            key = self._key(SUBSCRIBERS, publisher)
            if key:
                counts[key] = publisher.get_subscription_count()
        for subscription in (*self._node.subscriptions, *self._node.watched):
            key = self._key(PUBLISHERS, subscription)
            if key:
                counts[key] = subscription.get_publisher_count()
        return counts

    def _key(self, kind: str, end: Any) -> str:
        """Return the key of the count of a topic's other ends; '' if it is not to be counted.

        To ask rcl for the name of a topic takes longer than to count.
        """
        key = self._keys.get(end)
        if key is None:
            topic = end.topic_name
            key = self._keys[end] = '' if topic.endswith(_EXCLUDED) else f'{kind}{topic}'
        return key

    def soon(self) -> None:
        """Publish at the next check, once, however often this is called before."""
        self._looks = _LOOKS

    def publish(self) -> None:
        """Publish now."""
        self._looks = 0
        level, message, values = self._report()
        problems = self.connections.problems
        if problems:
            level = Level.WARN if level is Level.OK else level
            message = '; '.join((message, *problems))
        number = {NUMBER: self._publisher.published}
        values = {**values, **self._node.account(), **self._connections, **number}
        status = DiagnosticStatus(
            level=level.value,
            name=self._node.get_fully_qualified_name().lstrip('/'),
            hardware_id='kalman_ros',
            message=one_line(message, LONGEST),
            values=[
                KeyValue(key=key, value=_text(value))
                for key, value in values.items()
                if not (isinstance(value, float) and isnan(value))
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else one_line(str(value), LONGEST)
