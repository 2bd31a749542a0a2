# SPDX-License-Identifier: Apache-2.0
"""The options of the plant beside the scenario: pace, actuator and body faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import (
    Frame,
    IdleInput,
    Lockstep,
    NodeOptions,
    Priority,
    Rest,
)
from kalman_ros.simulation.faults.body import BodyOptions


@dataclass(frozen=True)
class PlantOptions(NodeOptions, BodyOptions):
    """Options of the plant."""

    realtime_priority: Priority = 30
    seed: Annotated[int, About('seed of all noise', minimum=0)] = 0
    lockstep: Lockstep = False
    lockstep_timeout: Annotated[
        float, About('how long to wait for an answer before saying so', 's', minimum=1e-3)
    ] = 2.0
    lockstep_window: Annotated[
        int,
        About(
            'lockstep: steps that may go by before the recorder confirms them; 0 for no recorder',
            minimum=0,
        ),
    ] = 0
    wait_for_estimate: Annotated[
        bool, About('lockstep: wait for the estimate, too, where the controller does not use it')
    ] = False
    force_timeout: Annotated[
        float,
        About('real time: the input goes to idle after this time without one', 's', minimum=0.0),
    ] = 0.5
    idle_input: IdleInput = 'zero'
    rest_until_input: Rest = True
    run_until: Annotated[
        float, About('seconds of simulated time after which to pause', 's', live=True)
    ] = 1e9
    frame: Frame = 'map'
    child_frame: Annotated[str, About('frame of the body')] = 'base_link'
