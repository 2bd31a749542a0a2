# SPDX-License-Identifier: Apache-2.0
"""The systems: each has a published recording and the parameter file of a careful owner."""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import sources

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    sources.diff_drive, sources.car_60s, sources.uwb_robot, sources.lidar_radar,
    sources.driven_pendulum, sources.imu_optical,
)  # fmt: skip
SYSTEMS = {read.__name__: System(read, robots=_ROBOTS) for read in _ALL}
