# SPDX-License-Identifier: Apache-2.0
"""What each node may be told beside the scenario; for the plant see `plant_options`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated

from kalman_ros.core import About

from .intake import LONGEST

Lockstep = Annotated[bool, About('step in turns with the other nodes, not in real time')]
Autostart = Annotated[
    bool,
    About('configure and activate at once, not on ~/change_state'),
]
Longest = Annotated[
    int,
    About(
        'longer messages are dropped, and counted',
        'bytes',
        minimum=100,
        live=True,
    ),
]
Learn = Annotated[bool, About('decode the numbers of messages in place: faster')]
Priority = Annotated[
    int,
    About(
        'real time: SCHED_FIFO priority to ask for; 0: none',
        minimum=0,
        maximum=99,
    ),
]
Rest = Annotated[
    bool,
    About('real time: the state stays at its initial value until the first input is received'),
]
Frame = Annotated[str, About('frame in which positions are given')]
#: One for all nodes: the plant, the estimator and the controller must mean the same.
IdleInput = Annotated[
    str, About("input while no controller acts: 'zero', or that which holds the 'equilibrium'")
]
#: One for both: what the estimator accepts, the controller must not refuse.
FutureTolerance = Annotated[
    float, About('how far ahead of now a stamp may be', 's', minimum=0.0, live=True)
]


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of the estimator."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    realtime_priority: Priority = 20
    implementation: Annotated[str, About('native, or filterpy for a cross-check')] = 'native'
    lockstep: Lockstep = False
    publish_rate: Annotated[
        float,
        About(
            'estimates a second, predicted to now; 0 for one at each reading',
            'Hz',
            minimum=0.0,
            maximum=1e4,
        ),
    ] = 0.0
    initialize: Annotated[str, About("start from the initial 'belief' or first 'reading'")] = (
        'belief'
    )
    rest_until_input: Rest = False
    window: Annotated[
        float, About('late readings are still fused if no older than this', 's', 0.0, live=True)
    ] = 1.0
    gate_recover_after: Annotated[
        int,
        About(
            'rejections in a row, of all sensors that see the same states and with none of them '
            'that agrees, after which the covariance is widened; 0 for never',
            minimum=0,
            live=True,
        ),
    ] = 20
    restart_after: Annotated[
        int,
        About(
            'readings in a row older than the window that mean the clock went back; 0: never',
            minimum=0,
            live=True,
        ),
    ] = 10
    max_gap: Annotated[
        float,
        About(
            'silence after which the estimator restarts; 0 for never',
            's',
            0.0,
            live=True,
        ),
    ] = 60.0
    future_tolerance: FutureTolerance = 1.0
    idle_input: IdleInput = 'zero'
    frame: Frame = 'map'
    child_frame: Annotated[str, About('frame of the body')] = 'base_link'


@dataclass(frozen=True)
class ControllerOptions:
    """Options of the controller."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    realtime_priority: Priority = 30
    lockstep: Lockstep = False
    enabled: Annotated[
        bool, About('whether forces are computed; if not, none is published (lockstep: idle ones)')
    ] = True
    idle_input: IdleInput = 'zero'
    input_limit: Annotated[
        Sequence[float],
        About('largest magnitude of each input; one for all', minimum=0.0, live=True),
    ] = (inf,)
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
            'largest standard deviation of each state that is acted upon; one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (inf,)
    resume: Annotated[
        str, About("after a fault resume at once, 'auto', or on ~/enable, 'enable'")
    ] = 'auto'
    transition_time: Annotated[
        float,
        About('how slowly the input goes over to other gains; 0 for a jump', 's', 0.0, live=True),
    ] = 0.5
    predict_latency: Annotated[
        bool, About('real time: predict each estimate by its age before answering it', live=True)
    ] = False
    frame: Frame = 'map'


@dataclass(frozen=True)
class MonitorOptions:
    """Options of the monitor."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    monitor_window: Annotated[
        int, About('estimates over which NEES and NIS are averaged', minimum=10)
    ] = 500
    confidence: Annotated[
        float,
        About('probability with which a consistent filter passes', minimum=0.5, maximum=1.0),
    ] = 0.999


@dataclass(frozen=True)
class MicrophoneArrayOptions:
    """Options of the microphone array."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    seed: Annotated[int, About('seed of all noise', minimum=0)] = 0
    lockstep: Lockstep = False
    frame: Frame = 'map'
    hears_for: Annotated[
        str, About('name of the sensor, of kind bearing, whose readings it publishes')
    ] = 'bearing'
    microphones: Annotated[
        Sequence[float], About('x and y of each microphone from the centre of the array', 'm')
    ] = (0.1, 0.0, 0.05, 0.0866, -0.05, 0.0866, -0.1, 0.0, -0.05, -0.0866, 0.05, -0.0866)
    speed_of_sound: Annotated[float, About('speed of sound', 'm/s', minimum=1.0)] = 343.0
    band: Annotated[
        Sequence[float], About('lowest and highest frequency that it listens to', 'Hz')
    ] = (200.0, 3000.0)
    frame_duration: Annotated[
        float, About('how long it listens for one bearing', 's', minimum=1e-3, maximum=10.0)
    ] = 0.1
    least_odds: Annotated[
        float,
        About(
            'a bearing is published if a source is N times likelier than noise; '
            'noise alone passes in at most one frame of N',
            minimum=1.0,
            live=True,
        ),
    ] = 1000.0
    largest_std: Annotated[
        float,
        About(
            'a bearing is published if its standard deviation is no larger', 'rad', 0.0, live=True
        ),
    ] = 0.2
    recording: Annotated[
        str, About("WAV file, one channel a microphone; '' to simulate the sound")
    ] = ''
    sample_rate: Annotated[
        float,
        About('of what is simulated; a recording has its own', 'Hz', minimum=100.0, maximum=1e6),
    ] = 16000.0
    sound_level: Annotated[
        float, About('simulated source: sound pressure at 1 m, RMS', 'Pa', minimum=0.0)
    ] = 1.0
    microphone_noise: Annotated[
        float, About('simulated noise of each microphone, RMS', 'Pa', minimum=0.0)
    ] = 0.02
