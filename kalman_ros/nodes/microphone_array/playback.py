# SPDX-License-Identifier: Apache-2.0
"""Playback of a recording in real time."""

from __future__ import annotations

from collections.abc import Callable

from kalman_ros.acoustics.recording import Recording
from kalman_ros.core import Array
from kalman_ros.nodes.middleware.host import Host


class Playback:
    """Returns frames of a recording as time passes, until its end.

    Parameters
    ----------
    node
        The node with the clocks.
    recorded
        The sound, which starts with the first subscriber.
    interval
        From one frame to the next, in seconds.
    samples
        Of a frame.
    subscribed
        Returns whether there is a subscriber.
    on_frame
        Called with the time of the middle of a frame, in nanoseconds, and the frame (M, samples).
    """

    def __init__(
        self,
        node: Host,
        recorded: Recording,
        interval: float,
        samples: int,
        subscribed: Callable[[], bool],
        on_frame: Callable[[int, Array], None],
    ) -> None:
        self._node, self._recorded = node, recorded
        self._interval, self._samples, self._on_frame = interval, samples, on_frame
        self._subscribed = subscribed
        self._frames = 0
        self._began = 0
        self._timer = node.create_timer(interval, self._play, clock=node.steady)

    def _play(self) -> None:
        if not self._frames:
            if not self._subscribed():
                return
            self._began = self._node.get_clock().now().nanoseconds
        start = self._frames * self._interval
        frame = self._recorded.frame(start, self._samples)
        if frame is None:
            self._node.get_logger().info(f'the recording is over after {start:g} s')
            self._timer.cancel()
            return
        self._frames += 1
        middle = start + 0.5 * self._samples / self._recorded.sample_rate
        self._on_frame(self._began + round(middle * 1e9), frame)
