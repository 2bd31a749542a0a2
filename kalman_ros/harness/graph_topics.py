# SPDX-License-Identifier: Apache-2.0
"""Topics of a ROS graph, of any type, as serialised messages."""

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

#: Largest number of messages of a topic that are kept between two reads.
_DEPTH = 5000
#: Topics of every node, which are omitted unless they are named.
_OF_NODES = ('/parameter_events', '/rosout')


@dataclass(frozen=True)
class OfferedTopic:
    """A published topic.

    Parameters
    ----------
    name
        Full name of the topic.
    kind
        Type of its messages, as ``package/msg/Name``.
    offered
        Quality of service of each publisher.
    digest
        Digest of the message type.
    """

    name: str
    kind: str
    offered: tuple[QoSProfile, ...]
    digest: str

    @property
    def kept(self) -> bool:
        """Whether later subscribers receive earlier messages, too."""
        strong = DurabilityPolicy.TRANSIENT_LOCAL
        return bool(_compatible_policy(self.offered, 'durability', strong) == strong)


class Received(NamedTuple):
    """A message with the times in nanoseconds at which it was received and published."""

    topic: str
    data: bytes
    received: int
    published: int


class GraphTopics:
    """The topics of a graph, and subscriptions to them; no message is decoded.

    No executor runs; `take` empties the queues of the middleware.

    Parameters
    ----------
    name
        Name of the node in the graph.
    topics
        Names of the topics; all topics of the graph if there are none.
    domain
        ROS domain; None for the domain of the environment.
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
        #: Context for other nodes of this process.
        self.context = rclpy.Context()
        rclpy.init(context=self.context, args=[], domain_id=domain)
        self.node = Node(name, context=self.context, start_parameter_services=False)
        self._requested = {self.node.resolve_topic_name(topic) for topic in topics}
        self._hidden = () if every else _OF_NODES
        self._subscriptions: dict[str, Any] = {}
        self._received = defaultdict[str, ReceptionTimes](ReceptionTimes)
        self._known: set[str] = set()
        #: Reason for which each refused topic cannot be subscribed to, by name.
        self.refused: dict[str, str] = {}

    @property
    def subscribed(self) -> list[str]:
        """Names of the subscribed topics."""
        return sorted(self._subscriptions)

    @property
    def absent(self) -> list[str]:
        """Names of the requested topics that have no publisher yet."""
        return sorted(self._requested - {*self._known, *self.refused})

    def new(self) -> Iterator[OfferedTopic]:
        """Yield the topics that have appeared since the last call."""
        for topic, kinds in self.node.get_topic_names_and_types():
            if topic in self._known or topic in self.refused:
                continue
            if topic not in self._requested if self._requested else topic in self._hidden:
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
            offered = tuple(publisher.qos_profile for publisher in publishers)
            digest = str(publishers[0].topic_type_hash)
            yield OfferedTopic(topic, kinds[0], offered, digest)

    def subscribe(self, topic: OfferedTopic) -> None:
        """Subscribe to a topic with a quality of service that all its publishers offer."""
        profile = QoSProfile(
            depth=_DEPTH,
            reliability=_compatible_policy(
                topic.offered, 'reliability', ReliabilityPolicy.RELIABLE
            ),
            durability=_compatible_policy(
                topic.offered, 'durability', DurabilityPolicy.TRANSIENT_LOCAL
            ),
        )
        self._subscriptions[topic.name] = self.node.create_subscription(
            message_type(topic.kind), topic.name, lambda _: None, profile, raw=True
        )

    def unsubscribe(self, topic: OfferedTopic) -> None:
        """End the subscription to a topic."""
        self.node.destroy_subscription(self._subscriptions.pop(topic.name))

    def take(self) -> Iterator[Received]:
        """Yield the messages that were received since the last call, topic by topic."""
        for topic, subscription in self._subscriptions.items():
            for _ in range(_DEPTH):
                message = private.take(subscription)
                if message is None:
                    break
                data, info = message
                received = self._received[topic](info['received_timestamp'])
                yield Received(topic, data, received, info['source_timestamp'])

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self.context.try_shutdown()


def _compatible_policy(offered: Collection[QoSProfile], policy: str, strong: Any) -> Any:
    """Return the ``strong`` policy if all publishers offer it, otherwise the weak policy."""
    if all(getattr(profile, policy) == strong for profile in offered):
        return strong
    weak = {'reliability': ReliabilityPolicy.BEST_EFFORT, 'durability': DurabilityPolicy.VOLATILE}
    return weak[policy]
