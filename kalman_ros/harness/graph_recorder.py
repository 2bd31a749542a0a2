# SPDX-License-Identifier: Apache-2.0
"""Records topics of the ROS graph, whatever their types, as the bytes that are on the wire."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from threading import Event
from time import monotonic
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import message_type

#: Messages of a topic that are kept between two looks, and seconds between them.
_DEPTH, _LOOK = 5000, 0.05
#: Seconds between two writes, no more of which is lost if this process is killed; and between two
#: looks at the graph.
_WRITE, _GRAPH = 0.5, 0.5
#: Topics of every node, which nobody records unless they are named.
_OF_NODES = ('/parameter_events', '/rosout')


class GraphRecorder:
    """Records topics, also those that appear later, until it is stopped.

    No message is decoded, and no executor runs: the queues of the middleware are emptied at
    intervals.

    Parameters
    ----------
    writer
        Of the recording.
    topics
        Names; all topics of the graph if there are none.
    domain
        Of ROS; that of the environment if it is None.
    """

    def __init__(
        self, writer: RecordingWriter, topics: Collection[str] = (), domain: int | None = None
    ) -> None:
        self._writer = writer
        self._context = rclpy.Context()
        rclpy.init(context=self._context, args=[], domain_id=domain)
        self._node = Node('recorder', context=self._context, start_parameter_services=False)
        self._wanted = {self._node.resolve_topic_name(topic) for topic in topics}
        self._subscriptions: dict[str, Any] = {}
        #: Why topics cannot be recorded, by name.
        self.refused: dict[str, str] = {}

    @property
    def topics(self) -> list[str]:
        """The topics that are recorded."""
        return sorted(self._subscriptions)

    @property
    def absent(self) -> list[str]:
        """The topics that were asked for and have no publisher yet."""
        return sorted(self._wanted - {*self._subscriptions, *self.refused})

    @property
    def count(self) -> int:
        """The number of messages."""
        return self._writer.count

    def run(self, stop: Event, seconds: float) -> None:
        """Record until ``stop`` is set, for at most ``seconds``."""
        end, written, looked = monotonic() + seconds, monotonic(), 0.0
        while True:
            now = monotonic()
            last = stop.is_set() or now >= end
            if now - looked >= _GRAPH and not last:
                looked = now
                self._look()
            self._take()
            if now - written >= _WRITE or last:
                written = now
                self._writer.flush()
            if last:
                return
            stop.wait(min(_LOOK, max(0.0, end - now)))

    def _look(self) -> None:
        """Subscribe to topics that are new."""
        for topic, kinds in self._node.get_topic_names_and_types():
            if topic in self._subscriptions or topic in self.refused:
                continue
            if topic in self._wanted if self._wanted else topic not in _OF_NODES:
                publishers = self._node.get_publishers_info_by_topic(topic)
                if publishers:
                    self._subscribe(topic, kinds, publishers)

    def _subscribe(self, topic: str, kinds: list[str], publishers: list[Any]) -> None:
        if len(kinds) > 1:
            self.refused[topic] = f'it has several types: {", ".join(kinds)}'
            return
        try:
            kind = message_type(kinds[0])
        except ValueError as error:
            self.refused[topic] = str(error)
            return
        offered = [publisher.qos_profile for publisher in publishers]
        profile = QoSProfile(
            depth=_DEPTH,
            reliability=_common(offered, 'reliability', ReliabilityPolicy.RELIABLE),
            durability=_common(offered, 'durability', DurabilityPolicy.TRANSIENT_LOCAL),
        )
        digest = str(publishers[0].topic_type_hash)
        self._writer.add(topic, kinds[0], [_described(each) for each in offered], digest)
        self._subscriptions[topic] = self._node.create_subscription(
            kind, topic, lambda _: None, profile, raw=True
        )

    def _take(self) -> None:
        """Write what was received since the last look."""
        write = self._writer.write
        for topic, subscription in self._subscriptions.items():
            for data, info in _waiting(subscription):
                write(topic, info['received_timestamp'], data, info['source_timestamp'])

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        self._context.try_shutdown()


def _waiting(subscription: Any) -> Iterator[tuple[bytes, Any]]:
    take, kind = subscription.handle.take_message, subscription.msg_type
    for _ in range(_DEPTH):
        found = take(kind, True)
        if found is None:
            return
        yield found


def _common(offered: list[QoSProfile], policy: str, strong: Any) -> Any:
    """Return the ``strong`` policy if all publishers offer it, else the one that fits all."""
    if all(getattr(profile, policy) == strong for profile in offered):
        return strong
    weak = {'reliability': ReliabilityPolicy.BEST_EFFORT, 'durability': DurabilityPolicy.VOLATILE}
    return weak[policy]


def _described(profile: QoSProfile) -> dict[str, Any]:
    """Return what a publisher offers in the words of rosbag2."""
    return {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'liveliness': profile.liveliness.name.lower(),
    }
