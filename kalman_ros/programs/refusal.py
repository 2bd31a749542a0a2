# SPDX-License-Identifier: Apache-2.0
"""Exit of a program that cannot do what was asked, or that is interrupted."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from kalman_ros.core.one_line import one_line


def refuse(program: str, error: Exception) -> NoReturn:
    """Print the reason in one line, and exit with code 2."""
    print(one_line(f'{program}: {error}'), file=sys.stderr)
    sys.exit(2)


@contextmanager
def interruptible(program: str) -> Iterator[None]:
    """Let Ctrl-C end a program with one line and code 130; also for use as a decorator."""
    try:
        yield
    except KeyboardInterrupt:
        print(f'{program}: interrupted', file=sys.stderr)
        sys.exit(130)
