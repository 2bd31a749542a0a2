# SPDX-License-Identifier: Apache-2.0
"""How a program ends when it cannot do what was asked."""

from __future__ import annotations

import sys
from typing import NoReturn

from kalman_ros.core.one_line import one_line


def refuse(program: str, error: Exception) -> NoReturn:
    """Print the reason in one line, and exit with code 2."""
    print(one_line(f'{program}: {error}'), file=sys.stderr)
    sys.exit(2)
