# SPDX-License-Identifier: Apache-2.0
"""What a node says of itself, once a second, on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node


class Level(Enum):
    """How a node is doing."""

    OK = DiagnosticStatus.OK
    WARN = DiagnosticStatus.WARN
    ERROR = DiagnosticStatus.ERROR


#: A level, a sentence, and what is behind it.
Report = tuple[Level, str, Mapping[str, Any]]


class Diagnostics:
    """Publishes what ``report`` returns every second of steady time, and whenever asked."""

    def __init__(self, node: Any, report: Callable[[], Report]) -> None:
        self._node: Node = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._timer = node.create_timer(1.0, self.publish, clock=node.steady)

    def publish(self) -> None:
        """Publish now."""
        level, message, values = self._report()
        status = DiagnosticStatus(
            level=level.value,
            name=self._node.get_fully_qualified_name().lstrip('/'),
            hardware_id='kalman_ros',
            message=message,
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
