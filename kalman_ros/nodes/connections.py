# SPDX-License-Identifier: Apache-2.0
"""Who publishes what a node subscribes to, and why nothing can arrive if nothing does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from time import monotonic
from typing import Any

from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

#: How long a connection may be missing before it is reported, in seconds.
PATIENCE = 3.0
#: Asking the graph about every topic takes milliseconds, which a loop misses. So it is asked at
#: most so often, in seconds, while something is wrong or has changed, and else seldom.
_SOON, _LATER = 1.0, 30.0
_ROS_OWN = ('/rosout', '/parameter_events', '/diagnostics')


class Connections:
    """Finds topics whose publishers and subscribers cannot reach each other.

    Parameters
    ----------
    node
        Whose publishers and subscriptions are compared with those of the others.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._awaited: list[Any] = []
        self._since: dict[str, float] = {}
        self._logged: set[str] = set()
        self._counts: list[tuple[str, int, int]] = []
        self._looked = -_LATER

    def expect(self, subscription: Any) -> Any:
        """Report from now on when nobody publishes to this subscription; return it."""
        subscriptions = [*self._subscriptions()]
        self._awaited = [known for known in self._awaited if known in subscriptions]
        self._awaited.append(subscription)
        return subscription

    def problems(self) -> list[str]:
        """Return what has been wrong for some seconds, and log what is new of it."""
        now = monotonic()
        if now - self._looked < _SOON:
            return [*self._logged]
        counts = self._count()
        if counts == self._counts and not self._since and now - self._looked < _LATER:
            return []
        self._counts, self._looked = counts, now
        self._since = {found: self._since.get(found, now) for found in self._mismatches()}
        lasting = [found for found, since in self._since.items() if now - since > PATIENCE]
        for found in lasting:
            if found not in self._logged:
                self._node.get_logger().warning(found)
        self._logged = {*lasting}
        return lasting

    def _count(self) -> list[tuple[str, int, int]]:
        """Return how many endpoints of any type each topic has; that costs microseconds."""
        node = self._node
        topics = [own.topic_name for own in (*self._subscriptions(), *node.publishers)]
        return [
            (name, node.count_publishers(name), node.count_subscribers(name)) for name in topics
        ]

    def _subscriptions(self) -> Iterator[Any]:
        yield from self._node.subscriptions
        yield from self._node.watched

    def _mismatches(self) -> Iterator[str]:
        node = self._node
        for own in self._subscriptions():
            topic = own.topic_name
            publishers = node.get_publishers_info_by_topic(topic)
            if not publishers and own in self._awaited:
                yield f'{topic}: no publishers'
            for here in self._ours(node.get_subscriptions_info_by_topic(topic)):
                for there in publishers:
                    why = _mismatch(here, there, there.qos_profile, here.qos_profile)
                    if why:
                        yield f'{topic}: {_name(there)} publishes {why}'
        for own in node.publishers:
            topic = own.topic_name
            if topic in _ROS_OWN:
                continue
            for here in self._ours(node.get_publishers_info_by_topic(topic)):
                for there in node.get_subscriptions_info_by_topic(topic):
                    why = _mismatch(here, there, here.qos_profile, there.qos_profile)
                    if why:
                        yield f'{topic}: {_name(there)} subscribes to {why}'

    def _ours(self, endpoints: Iterable[Any]) -> list[Any]:
        """Return those of this node; what the graph says of them is complete, unlike a profile."""
        name = self._node.get_fully_qualified_name()
        return [endpoint for endpoint in endpoints if _name(endpoint) == name]


def _mismatch(own: Any, other: Any, offered: QoSProfile, wanted: QoSProfile) -> str:
    """Return why ``own`` and ``other``, an endpoint of another node, cannot connect; or ''."""
    if other.topic_type != own.topic_type:
        return f'{_short(other.topic_type)}, expected {_short(own.topic_type)}'
    compatibility, reason = qos_check_compatible(offered, wanted)
    if compatibility == QoSCompatibility.ERROR:
        return f'with another quality of service: {reason.removeprefix("ERROR: ").rstrip(";. ")}'
    return ''


def _name(endpoint: Any) -> str:
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _short(name: str) -> str:
    return name.replace('/msg/', '/')
