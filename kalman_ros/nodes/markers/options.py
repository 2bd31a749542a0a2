# SPDX-License-Identifier: Apache-2.0
"""The options of the markers beside the scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import Frame, NodeOptions


@dataclass(frozen=True)
class MarkersOptions(NodeOptions):
    """Options of the node that draws markers."""

    frame: Frame = 'map'
    marker_rate: Annotated[float, About('how often markers are drawn', 'Hz', 0.1, 100.0)] = 10.0
    track_length: Annotated[int, About('points of a track', minimum=1, maximum=100_000)] = 1000
