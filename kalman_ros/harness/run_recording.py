# SPDX-License-Identifier: Apache-2.0
"""Recording of the topics of a run, which is written while the nodes run."""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from typing import Any

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import full_type
from kalman_ros.nodes.middleware.watcher import WatcherNode

#: Interval in seconds of writes, the most that is lost if this process is killed.
_PERIOD = 0.5


class RunRecording:
    """A recording of the topics that a node watches.

    Parameters
    ----------
    node
        Node that watches the topics.
    folder
        New folder, or a folder with an earlier recording, which is replaced.

    Raises
    ------
    ValueError
        If the folder has other content or cannot be created.
    """

    def __init__(self, node: WatcherNode, folder: str | Path) -> None:
        self._node = node
        self._writer = RecordingWriter(folder, replace=True)
        self._written = monotonic()

    def add(self, subscription: Any) -> None:
        """Add the topic of a subscription."""
        kind = subscription.msg_type
        package = kind.__module__.partition('.')[0]
        self._writer.add(subscription.topic_name, full_type(f'{package}/{kind.__name__}'))

    def write(self, topic: str, data: bytes) -> None:
        """Write the message that the node has just received, by the full name of the topic."""
        received, published = self._node.times
        self._writer.write(topic, received, data, published)

    def flush(self) -> None:
        """Write received messages at regular intervals; raise OSError if the disk is full.

        Do not call this in a callback for messages, where rclpy would log a traceback.
        """
        now = monotonic()
        if now - self._written > _PERIOD:
            self._written = now
            self._writer.flush()

    def close(self) -> None:
        """Write the remaining messages and close the file."""
        self._writer.close()
