# SPDX-License-Identifier: Apache-2.0
"""The log of a node: one line a message, whatever it quotes."""

from __future__ import annotations

import os
from typing import Any

from rclpy.logging import LoggingSeverity

from kalman_ros.core.one_line import one_line

from . import private

#: The most characters of a line.
LONGEST = 2000

private.log_for_callers_of(os.path.realpath(__file__))


class OneLineLogger(private.Logger):  # type: ignore[misc]
    """A logger of `rclpy` that escapes line breaks and control characters.

    A frame or a name in a message can contain any: a terminal would obey them.
    """

    def log(self, message: object, severity: LoggingSeverity, **options: Any) -> bool:
        """Log a message in one line."""
        return bool(super().log(one_line(str(message), LONGEST), severity, **options))
