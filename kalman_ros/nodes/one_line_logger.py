# SPDX-License-Identifier: Apache-2.0
"""The log of a node: one line a message, whatever it quotes."""

from __future__ import annotations

import os
from typing import Any

from rclpy.impl import rcutils_logger
from rclpy.logging import LoggingSeverity

from kalman_ros.core.one_line import one_line

#: The most characters of a line.
LONGEST = 2000

# rclpy limits the rate of a message by the line that logs it, which is not here
rcutils_logger._internal_callers.append(os.path.realpath(__file__))


class OneLineLogger(rcutils_logger.RcutilsLogger):  # type: ignore[misc]
    """A logger of `rclpy` that escapes line breaks and control characters.

    A frame or a name in a message can contain any: a terminal would obey them.
    """

    def log(self, message: object, severity: LoggingSeverity, **options: Any) -> bool:
        """Log a message in one line."""
        return bool(super().log(one_line(str(message), LONGEST), severity, **options))
