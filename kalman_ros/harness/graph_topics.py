# SPDX-License-Identifier: Apache-2.0
"""The topics of a ROS graph, whatever their types, as the bytes that are on the wire."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from kalman_ros.codecs.messages import message_type
from kalman_ros.nodes.middleware import private
from kalman_ros.nodes.middleware.reception import ReceptionTimes

#: Messages of a topic that are kept between two reads.
_DEPTH = 5000
#: Topics of every node, which are left out unless they are named.
_OF_NODES = ('/parameter_events', '/rosout')


@dataclass(frozen=True)
class OfferedTopic:
    """A topic that is published.

    Parameters
    ----------
    name
        Its full name.
    kind
        Of its messages, as ``package/msg/Name``.
    offered
        The quality of service of each publisher.
    digest
        Of the message type.
    """

    name: str
    kind: str
    offered: tuple[QoSProfile, ...]
    digest: str

    @property
    def kept(self) -> bool:
        """Whether later subscribers receive earlier messages, too."""
        strong = DurabilityPolicy.TRANSIENT_LOCAL
        return bool(_common(self.offered, 'durability', strong) == strong)


class Received(NamedTuple):
    """A message, with when it was received and published, in nanoseconds."""

    topic: str
    data: bytes
    received: int
    published: int


class GraphTopics:
    """Finds topics and reads the subscribed ones; no message is decoded.

    No executor runs: the queues of the middleware are emptied by `take`.

    Parameters
    ----------
    name
        Of the node in the graph.
    topics
        Names; all topics of the graph if there are none.
    domain
        Of ROS; that of the environment if it is None.
    every
        Whether all topics of the graph include those that every node publishes.
    """

    def __init__(
        self,
        name: str,
        topics: Collection[str] = (),
        domain: int | None = None,
        *,
        every: bool = False,
    ) -> None:
        #: For other nodes of this process.
        self.context = rclpy.Context()
        rclpy.init(context=self.context, args=[], domain_id=domain)
        self.node = Node(name, context=self.context, start_parameter_services=False)
        self._wanted = {self.node.resolve_topic_name(topic) for topic in topics}
        self._hidden = () if every else _OF_NODES
        self._subscriptions: dict[str, Any] = {}
        self._received = defaultdict[str, ReceptionTimes](ReceptionTimes)
        self._known: set[str] = set()
        #: Why topics cannot be subscribed to, by name.
        self.refused: dict[str, str] = {}

    @property
    def subscribed(self) -> list[str]:
        """The names of the subscribed topics."""
        return sorted(self._subscriptions)

    @property
    def absent(self) -> list[str]:
        """The names that were asked for and have no publisher yet."""
        return sorted(self._wanted - {*self._known, *self.refused})

    def new(self) -> Iterator[OfferedTopic]:
        """Yield the topics that have appeared since the last call."""
        for topic, kinds in self.node.get_topic_names_and_types():
            if topic in self._known or topic in self.refused:
                continue
            if topic not in self._wanted if self._wanted else topic in self._hidden:
                continue
            publishers = self.node.get_publishers_info_by_topic(topic)
            if not publishers:
                continue
            try:
                if len(kinds) > 1:
                    raise ValueError(f'it has several types: {", ".join(kinds)}')
                message_type(kinds[0])
            except ValueError as error:
                self.refused[topic] = str(error)
                continue
            self._known.add(topic)
            offered = tuple(each.qos_profile for each in publishers)
            digest = str(publishers[0].topic_type_hash)
            yield OfferedTopic(topic, kinds[0], offered, digest)

    def subscribe(self, topic: OfferedTopic) -> None:
        """Subscribe to a topic, as all its publishers permit."""
        profile = QoSProfile(
            depth=_DEPTH,
            reliability=_common(topic.offered, 'reliability', ReliabilityPolicy.RELIABLE),
            durability=_common(topic.offered, 'durability', DurabilityPolicy.TRANSIENT_LOCAL),
        )
        self._subscriptions[topic.name] = self.node.create_subscription(
            message_type(topic.kind), topic.name, lambda _: None, profile, raw=True
        )

    def unsubscribe(self, topic: OfferedTopic) -> None:
        """End the subscription to a topic."""
        self.node.destroy_subscription(self._subscriptions.pop(topic.name))

    def take(self) -> Iterator[Received]:
        """Yield what was received since the last call, topic by topic."""
        for topic, subscription in self._subscriptions.items():
            for _ in range(_DEPTH):
                found = private.take(subscription)
                if found is None:
                    break
                data, info = found
                received = self._received[topic](info['received_timestamp'])
                yield Received(topic, data, received, info['source_timestamp'])

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self.context.try_shutdown()


def _common(offered: Collection[QoSProfile], policy: str, strong: Any) -> Any:
    """Return the ``strong`` policy if all publishers offer it, else the one that fits all."""
    if all(getattr(profile, policy) == strong for profile in offered):
        return strong
    weak = {'reliability': ReliabilityPolicy.BEST_EFFORT, 'durability': DurabilityPolicy.VOLATILE}
    return weak[policy]
