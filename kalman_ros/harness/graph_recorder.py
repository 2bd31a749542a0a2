# SPDX-License-Identifier: Apache-2.0
"""Recorder of topics of the ROS graph, of any type, as serialised messages."""

from __future__ import annotations

from collections.abc import Collection
from threading import Event
from time import monotonic
from typing import Any

from rclpy.qos import QoSProfile

from kalman_ros.bags.recording_writer import RecordingWriter

from .graph_topics import GraphTopics

#: Interval in seconds of checks for messages.
_LOOK = 0.05
#: Interval in seconds of writes, the most that is lost if this process is killed, and of checks of
#: the graph.
_WRITE, _GRAPH = 0.5, 0.5


class GraphRecorder:
    """A recorder of topics, including topics that appear later, until it is stopped.

    Parameters
    ----------
    writer
        Writer of the recording.
    topics
        Names of the topics; all topics of the graph if there are none.
    domain
        ROS domain; None for the domain of the environment.
    """

    def __init__(
        self, writer: RecordingWriter, topics: Collection[str] = (), domain: int | None = None
    ) -> None:
        self._writer = writer
        self._graph = GraphTopics('recorder', topics, domain)

    @property
    def topics(self) -> list[str]:
        """Names of the topics that are recorded."""
        return self._graph.subscribed

    @property
    def absent(self) -> list[str]:
        """Names of the requested topics that have no publisher yet."""
        return self._graph.absent

    @property
    def refused(self) -> dict[str, str]:
        """Reason for which each refused topic cannot be recorded, by name."""
        return self._graph.refused

    @property
    def count(self) -> int:
        """Number of recorded messages."""
        return self._writer.count

    def run(self, stop: Event, seconds: float) -> None:
        """Record until ``stop`` is set, for at most ``seconds``."""
        end, written, looked = monotonic() + seconds, monotonic(), 0.0
        while True:
            now = monotonic()
            last = stop.is_set() or now >= end
            if now - looked >= _GRAPH and not last:
                looked = now
                self._subscribe_new()
            for topic, data, received, published in self._graph.take():
                self._writer.write(topic, received, data, published)
            if now - written >= _WRITE or last:
                written = now
                self._writer.flush()
            if last:
                return
            stop.wait(min(_LOOK, max(0.0, end - now)))

    def _subscribe_new(self) -> None:
        """Subscribe to the topics that have appeared."""
        for topic in self._graph.new():
            offered = [_qos_entry(profile) for profile in topic.offered]
            self._writer.add(topic.name, topic.kind, offered, topic.digest)
            self._graph.subscribe(topic)

    def close(self) -> None:
        """Leave the graph."""
        self._graph.close()


def _qos_entry(profile: QoSProfile) -> dict[str, Any]:
    """Return the quality of service of a publisher in the notation of rosbag2."""
    return {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'liveliness': profile.liveliness.name.lower(),
    }
