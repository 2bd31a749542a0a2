# SPDX-License-Identifier: Apache-2.0
"""The options of the monitor beside the scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import NodeOptions


@dataclass(frozen=True)
class MonitorOptions(NodeOptions):
    """Options of the monitor."""

    monitor_window: Annotated[
        int, About('estimates over which NEES and NIS are averaged', minimum=10)
    ] = 500
    confidence: Annotated[
        float, About('probability with which a consistent filter passes', minimum=0.5, maximum=1.0)
    ] = 0.999
