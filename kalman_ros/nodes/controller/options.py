# SPDX-License-Identifier: Apache-2.0
"""The options of the controller beside the scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated

from kalman_ros.control.feedback import TRANSITION_TIME
from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import (
    Frame,
    FutureTolerance,
    IdleInput,
    Lockstep,
    NodeOptions,
    Priority,
)

#: Allowed values of ``resume``, the behaviour after a fault.
RESUME = ('automatic', 'enable', 'never')


@dataclass(frozen=True)
class ControllerOptions(NodeOptions):
    """Options of the controller."""

    realtime_priority: Priority = 30
    lockstep: Lockstep = False
    enabled: Annotated[
        bool, About('whether forces are computed; if not, none is published (lockstep: idle ones)')
    ] = True
    idle_input: IdleInput = 'zero'
    input_limit: Annotated[
        Sequence[float],
        About(
            'largest magnitude of each input, beside a lower limit its largest value; one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (inf,)
    input_lower_limit: Annotated[
        Sequence[float],
        About(
            'smallest value of each input, one for all; -.inf: minus its input_limit', live=True
        ),
    ] = (-inf,)
    input_rate_limit: Annotated[
        Sequence[float],
        About('largest change of each input a second; one for all', minimum=0.0, live=True),
    ] = (inf,)
    estimate_timeout: Annotated[
        float,
        About(
            'real time: the input goes to idle when the estimate is older, by its stamp or by '
            'its arrival; 0 for never',
            's',
            minimum=0.0,
            live=True,
        ),
    ] = 0.5
    future_tolerance: FutureTolerance = 1.0
    max_std: Annotated[
        Sequence[float],
        About(
            'largest accepted standard deviation of each state; one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (inf,)
    resume: Annotated[
        str,
        About(
            "after a fault resume at once, 'automatic', on ~/enable, 'enable', or stop, 'never': "
            'then on ~/reset and ~/enable'
        ),
    ] = 'automatic'
    heartbeat_timeout: Annotated[
        float,
        About('real time: the input goes to idle after this time without heartbeat', 's', 0.0),
    ] = 0.0
    transition_time: Annotated[
        float,
        About('duration of the transition to other gains; 0 for a jump', 's', 0.0, live=True),
    ] = TRANSITION_TIME
    path_speed: Annotated[
        float, About('largest speed on a path without times', 'm/s', minimum=1e-6, live=True)
    ] = 0.5
    path_acceleration: Annotated[
        float, About('largest acceleration on such a path', 'm/s^2', minimum=1e-6, live=True)
    ] = 0.5
    path_tolerance: Annotated[
        float,
        About(
            'how far a motion may be from the path or trajectory, in the unit of each state, '
            'beyond a tenth of its extent; right angles are cut by that at most',
            minimum=0.0,
            live=True,
        ),
    ] = 0.05
    reference_timeout: Annotated[
        float, About('how long a set point with a velocity moves on without a newer one', 's', 0.0)
    ] = 0.5
    solve_timeout: Annotated[
        float,
        About(
            'real time, law mpc: longest time to plan; then the last plan goes on; 0 for any',
            's',
            0.0,
        ),
    ] = 0.005
    predict_latency: Annotated[
        bool, About('real time: predict each estimate by its age before use', live=True)
    ] = False
    frame: Frame = 'map'
