# SPDX-License-Identifier: Apache-2.0
"""Publishers and subscribers of a node's topics, and reasons why they cannot connect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from time import monotonic
from typing import Any

from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

#: How long a connection may be missing before it is reported, in seconds.
PATIENCE = 3.0
#: The interval, in seconds, between checks of all topics while something is wrong or has changed;
#: otherwise checks are rare.
_SOON, _LATER = 1.0, 30.0
_ROS_OWN = ('/rosout', '/parameter_events', '/diagnostics')
#: Topics that several nodes publish together.
_SHARED = ('tf', 'tf_static', 'bond')


class Connections:
    """Finds topics whose publishers and subscribers cannot reach each other.

    Querying the graph about a topic takes a good part of a millisecond, and about all of them more
    than a loop can spare. So each `look` queries one.

    Parameters
    ----------
    node
        The node whose endpoints are compared with those of the others.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._awaited: list[Any] = []
        self._counts: list[tuple[str, int, int]] = []
        self._counted = self._looked = -_LATER
        self._left: list[Callable[[], Iterator[str]]] = []
        self._found: list[str] = []
        self._since: dict[str, float] = {}
        #: Problems that have lasted for some seconds.
        self.problems: list[str] = []

    def expect(self, subscription: Any) -> Any:
        """Report this subscription while it has no publishers; return it."""
        subscriptions = [*self._subscriptions()]
        self._awaited = [known for known in self._awaited if known in subscriptions]
        self._awaited.append(subscription)
        return subscription

    def look(self) -> None:
        """Check the next topic, if there is a reason to, and log new problems that last."""
        if not self._left:
            self._begin()
            return
        self._found += self._left.pop()()
        if not self._left:
            self._conclude()

    def _begin(self) -> None:
        now = monotonic()
        if now - self._counted < _SOON:
            return
        self._counted = now
        subscriptions, publishers = [*self._subscriptions()], [*self._node.publishers]
        counts = [self._count(endpoint.topic_name) for endpoint in (*subscriptions, *publishers)]
        if counts == self._counts and not self._since and now - self._looked < _LATER:
            return
        self._counts, self._looked, self._found = counts, now, []
        self._left = [
            partial(self._of_subscription, subscription.topic_name, subscription in self._awaited)
            for subscription in subscriptions
        ]
        self._left += [
            partial(self._of_publisher, publisher.topic_name)
            for publisher in publishers
            if publisher.topic_name not in _ROS_OWN
        ]

    def _conclude(self) -> None:
        now = monotonic()
        self._since = {problem: self._since.get(problem, now) for problem in self._found}
        lasting = [problem for problem, since in self._since.items() if now - since > PATIENCE]
        for problem in lasting:
            if problem not in self.problems:
                self._node.get_logger().warning(problem)
        self.problems = lasting

    def _count(self, topic: str) -> tuple[str, int, int]:
        """Return how many endpoints of any type a topic has, within microseconds."""
        return topic, self._node.count_publishers(topic), self._node.count_subscribers(topic)

    def _subscriptions(self) -> Iterator[Any]:
        yield from self._node.subscriptions
        yield from self._node.watched

    def _of_subscription(self, topic: str, awaited: bool) -> Iterator[str]:
        node = self._node
        publishers = node.get_publishers_info_by_topic(topic)
        if not publishers and awaited:
            yield f'{topic}: no publishers'
        ours = self._ours(node.get_subscriptions_info_by_topic(topic))
        for there in publishers:
            reasons = [
                _mismatch(here, there, there.qos_profile, here.qos_profile) for here in ours
            ]
            if ours and all(reasons):  # one subscription that connects is enough
                yield f'{topic}: {_name(there)} publishes {reasons[0]}'

    def _of_publisher(self, topic: str) -> Iterator[str]:
        node = self._node
        publishers = node.get_publishers_info_by_topic(topic)
        ours, others = self._ours(publishers), _others(node, publishers)
        shared = topic.rpartition('/')[2] in _SHARED  # in whatever namespace
        if others and not shared:
            yield f'{topic}: {" and ".join(others)} publishes here, too'
        if len(ours) > 1 and not shared:
            # the same words on all topics: one line
            yield f'there is a second node with the name {_name(ours[0])}'
        for here in ours:
            for there in node.get_subscriptions_info_by_topic(topic):
                why = _mismatch(here, there, here.qos_profile, there.qos_profile)
                if why:
                    yield f'{topic}: {_name(there)} subscribes to {why}'

    def _ours(self, endpoints: Iterable[Any]) -> list[Any]:
        """Return the endpoints of this node; the graph is complete for them, unlike a profile."""
        name = self._node.get_fully_qualified_name()
        return [endpoint for endpoint in endpoints if _name(endpoint) == name]


def other_publishers(node: Any, topic: str) -> list[str]:
    """Return the sorted names of the other nodes that publish on a topic."""
    return _others(node, node.get_publishers_info_by_topic(topic))


def _others(node: Any, endpoints: Iterable[Any]) -> list[str]:
    return sorted({_name(endpoint) for endpoint in endpoints} - {node.get_fully_qualified_name()})


def _mismatch(endpoint: Any, other: Any, offered: QoSProfile, wanted: QoSProfile) -> str:
    """Return why ``endpoint`` and ``other``, one of another node, cannot connect; or ''."""
    if other.topic_type != endpoint.topic_type:
        return f'{_short(other.topic_type)}, expected {_short(endpoint.topic_type)}'
    compatibility, reason = qos_check_compatible(offered, wanted)
    if compatibility == QoSCompatibility.ERROR:
        return f'with another quality of service: {reason.removeprefix("ERROR: ").rstrip(";. ")}'
    return ''


def _name(endpoint: Any) -> str:
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _short(name: str) -> str:
    return name.replace('/msg/', '/')
