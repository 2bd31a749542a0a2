# SPDX-License-Identifier: Apache-2.0
"""A path for the controller of a run, as a planner publishes it."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration

from kalman_ros.core import Array

from .run import Run

#: Topic of paths, and the longest wait in seconds for a controller that subscribes.
_TOPIC, _WAIT = 'reference/path', 60.0
#: The longest wait for an acknowledgement, which the middleware may lose.
_ACKNOWLEDGED = Duration(seconds=5.0)


def publish_path(run: Run, points: Array) -> None:
    """Publish positions (k, 2) in m on ``reference/path``; return when the controller has them.

    Raises
    ------
    RuntimeError
        If no controller listens.
    """
    publisher = run.node.create_publisher(Path, _TOPIC, 1)
    run.wait(publisher.get_subscription_count, _WAIT, lambda: f'no subscriber of {_TOPIC}')
    deliver(run, publisher, path_message(points))


def deliver(run: Run, publisher: Any, message: Any) -> None:
    """Publish a message, and return when the controller has processed it."""
    publisher.publish(message)
    publisher.wait_for_all_acked(_ACKNOWLEDGED)
    run.settle('controller')


def path_message(points: Array) -> Path:
    """Return a path of positions (k, 2), without times and headings."""
    message = Path()
    for x, y in points.tolist():
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = x, y, 1.0
        message.poses.append(pose)
    return message
