# SPDX-License-Identifier: Apache-2.0
"""Records topics of the ROS graph, whatever their types, as the bytes that are on the wire."""

from __future__ import annotations

from collections.abc import Collection
from threading import Event
from time import monotonic
from typing import Any

from rclpy.qos import QoSProfile

from kalman_ros.bags.recording_writer import RecordingWriter

from .graph_topics import GraphTopics

#: Seconds between two looks for messages.
_LOOK = 0.05
#: Seconds between two writes, no more of which is lost if this process is killed; and between two
#: looks at the graph.
_WRITE, _GRAPH = 0.5, 0.5


class GraphRecorder:
    """Records topics, also those that appear later, until it is stopped.

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
        self._graph = GraphTopics('recorder', topics, domain)

    @property
    def topics(self) -> list[str]:
        """The topics that are recorded."""
        return self._graph.subscribed

    @property
    def absent(self) -> list[str]:
        """The topics that were asked for and have no publisher yet."""
        return self._graph.absent

    @property
    def refused(self) -> dict[str, str]:
        """Why topics cannot be recorded, by name."""
        return self._graph.refused

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
            for topic, data, received, published in self._graph.take():
                self._writer.write(topic, received, data, published)
            if now - written >= _WRITE or last:
                written = now
                self._writer.flush()
            if last:
                return
            stop.wait(min(_LOOK, max(0.0, end - now)))

    def _look(self) -> None:
        """Subscribe to topics that are new."""
        for topic in self._graph.new():
            offered = [_described(each) for each in topic.offered]
            self._writer.add(topic.name, topic.kind, offered, topic.digest)
            self._graph.subscribe(topic)

    def close(self) -> None:
        """Leave the graph."""
        self._graph.close()


def _described(profile: QoSProfile) -> dict[str, Any]:
    """Return what a publisher offers in the words of rosbag2."""
    return {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'liveliness': profile.liveliness.name.lower(),
    }
