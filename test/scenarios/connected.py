# SPDX-License-Identifier: Apache-2.0
"""A publisher that waits for its subscribers, for tests and the programs that they start."""

import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.task import Future


def publisher(node, kind, topic, qos, subscribers):
    """Return a publisher once it has N ``subscribers``."""
    found = Future()

    def on_match(info):
        if info.current_count >= subscribers and not found.done():
            found.set_result(info.current_count)

    created = node.create_publisher(
        kind, topic, qos, event_callbacks=PublisherEventCallbacks(matched=on_match)
    )
    rclpy.spin_until_future_complete(node, found)
    return created


def acknowledged(publisher):
    """Wait until every subscriber has what was published; a subscriber that ended fails."""
    assert publisher.wait_for_all_acked(Duration(seconds=60.0)), 'not acknowledged within 60 s'
