# SPDX-License-Identifier: Apache-2.0
"""The options of an estimator beside the scenario, and those that several nodes share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.compiled.parts import COMPILED
from kalman_ros.core import About

from .intake import LONGEST

Lockstep = Annotated[bool, About('step in turns with the other nodes, not in real time')]
Priority = Annotated[
    int, About('real time: SCHED_FIFO priority to ask for; 0: none', minimum=0, maximum=99)
]
Rest = Annotated[bool, About('real time: rest until the first input')]
Frame = Annotated[str, About('frame in which positions are given')]
#: Shared by all nodes: the plant, the estimator and the controller must agree.
IdleInput = Annotated[str, About("while no controller acts: 'zero' or 'equilibrium'")]
#: Shared by both: the controller must not refuse what the estimator accepts.
FutureTolerance = Annotated[
    float, About('how far ahead of now a stamp may be', 's', minimum=0.0, live=True)
]


@dataclass(frozen=True)
class NodeOptions:
    """Options of every node."""

    autostart: Annotated[
        bool, About('configure and activate at the start, not on ~/change_state')
    ] = True
    max_message_size: Annotated[
        int, About('longer messages are dropped, and counted', 'bytes', minimum=100, live=True)
    ] = LONGEST
    learn_layouts: Annotated[bool, About('decode the numbers of messages in place: faster')] = True


@dataclass(frozen=True)
class EstimatorOptions(NodeOptions):
    """Options of the estimator."""

    realtime_priority: Priority = 20
    implementation: Annotated[str, About('native, or filterpy for a cross-check')] = 'native'
    arithmetic: Annotated[str, About("'compiled', 'numpy' or 'c' (all of it)")] = COMPILED
    lockstep: Lockstep = False
    publish_rate: Annotated[
        float,
        About('predicted estimates a second; 0: one per reading', 'Hz', minimum=0.0, maximum=1e4),
    ] = 0.0
    initialize: Annotated[str, About("start from 'belief', 'reading' (the first) or 'rest'")] = (
        'belief'
    )
    rest_until_input: Rest = False
    window: Annotated[
        float,
        About('late readings are still fused if no older than this', 's', 0.0, 3600.0, live=True),
    ] = 1.0
    gate_recover_after: Annotated[
        int, About('outside gates in a row: belief is widened; 0: never', minimum=0, live=True)
    ] = 20
    restart_after: Annotated[
        int,
        About('readings in a row too old: the clock went back; 0: never', minimum=0, live=True),
    ] = 10
    max_gap: Annotated[
        float,
        About('silence after which the estimator restarts; 0 for never', 's', 0.0, live=True),
    ] = 60.0
    future_tolerance: FutureTolerance = 1.0
    idle_input: IdleInput = 'zero'
    input_timeout: Annotated[
        float,
        About(
            'without a new input the idle one holds; 0: never',
            's',
            0.0,
            3600.0,
            feature='stand-still',
        ),
    ] = 0.0
    fixed_lag: Annotated[
        float,
        About(
            'readings of this long after each state on estimate/smoothed; 0: none',
            's',
            0.0,
            10.0,
            feature='smoothed',
        ),
    ] = 0.0
    frame: Frame = 'map'
    child_frame: Annotated[str, About('frame of the body')] = 'base_link'
    publish_odometry: Annotated[
        bool, About('pose and twist as Odometry on estimate/odometry', feature='tf')
    ] = False
    publish_tf: Annotated[bool, About('the pose as a transform on /tf', feature='tf')] = False
    odom_frame: Annotated[
        str,
        About('frame of child_frame on /tf: the transform is to it (map to odom)', feature='tf'),
    ] = ''
    tf_time_offset: Annotated[
        float, About('added to the stamps of transforms', 's', -60.0, 60.0, feature='tf')
    ] = 0.0
    tf_timeout: Annotated[
        float, About('no transform after this long without a reading', 's', 1e-3, feature='tf')
    ] = 1.0
    publish_fix: Annotated[
        bool, About('the position as NavSatFix on estimate/fix, too', feature='fixes')
    ] = False
    datum_file: Annotated[
        str, About("keeps the datum of the first fix over restarts; '': none", feature='fixes')
    ] = ''
