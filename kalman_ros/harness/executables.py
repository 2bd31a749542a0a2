# SPDX-License-Identifier: Apache-2.0
"""Installed executables of the package."""

from __future__ import annotations

import sys
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

PACKAGE = 'kalman_ros'


def prefix() -> Path:
    """Return the installation prefix of the package.

    Raises
    ------
    RuntimeError
        If the package is not installed; the message contains the remedy.
    """
    try:
        return Path(get_package_prefix(PACKAGE))
    except (PackageNotFoundError, LookupError, OSError):  # OSError: no workspace is sourced
        beside = Path(sys.argv[0]).resolve().parent
        if (beside / 'plant').exists() and beside.parent.name == 'lib':
            return beside.parent.parent
    raise RuntimeError(
        f'{PACKAGE} is not installed: build it with colcon and source install/setup.bash'
    )


def executable(name: str) -> Path:
    """Return the path of an executable, as of ``ros2 run``; raise RuntimeError without one."""
    path = prefix() / 'lib' / PACKAGE / name
    if not path.exists():
        raise RuntimeError(f"there is no executable '{name}' in {path.parent}")
    return path
