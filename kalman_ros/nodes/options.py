# SPDX-License-Identifier: Apache-2.0
"""The options of each node beside the scenario; for the plant see `plant_options`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated

from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import (
    Autostart,
    Frame,
    FutureTolerance,
    IdleInput,
    Learn,
    Lockstep,
    Longest,
    Priority,
)
from kalman_ros.pipeline.estimator_options import EstimatorOptions as EstimatorOptions
from kalman_ros.pipeline.intake import LONGEST


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
            'largest accepted standard deviation of each state; one for all',
            minimum=0.0,
            live=True,
        ),
    ] = (inf,)
    resume: Annotated[
        str, About("after a fault resume at once, 'auto', or on ~/enable, 'enable'")
    ] = 'auto'
    transition_time: Annotated[
        float,
        About('duration of the transition to other gains; 0 for a jump', 's', 0.0, live=True),
    ] = 0.5
    predict_latency: Annotated[
        bool, About('real time: predict each estimate by its age before use', live=True)
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
class MarkersOptions:
    """Options of the node that draws markers."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    frame: Frame = 'map'
    marker_rate: Annotated[float, About('how often markers are drawn', 'Hz', 0.1, 100.0)] = 10.0
    track_length: Annotated[int, About('points of a track', minimum=1, maximum=100_000)] = 1000


@dataclass(frozen=True)
class MicrophoneArrayOptions:
    """Options of the microphone array."""

    autostart: Autostart = True
    max_message_size: Longest = LONGEST
    learn_layouts: Learn = True
    seed: Annotated[int, About('seed of all noise', minimum=0)] = 0
    lockstep: Lockstep = False
    frame: Frame = 'map'
    bearing_sensor: Annotated[str, About('sensor of kind bearing whose readings it publishes')] = (
        'bearing'
    )
    microphones: Annotated[
        Sequence[float], About('x and y of each microphone from the centre of the array', 'm')
    ] = (0.1, 0.0, 0.05, 0.0866, -0.05, 0.0866, -0.1, 0.0, -0.05, -0.0866, 0.05, -0.0866)
    speed_of_sound: Annotated[float, About('speed of sound', 'm/s', minimum=1.0)] = 343.0
    band: Annotated[Sequence[float], About('lowest and highest frequency in use', 'Hz')] = (
        200.0,
        3000.0,
    )
    frame_duration: Annotated[
        float, About('length of a frame of sound', 's', minimum=1e-3, maximum=10.0)
    ] = 0.1
    least_odds: Annotated[
        float,
        About(
            'a bearing is published if a source is N times as likely as noise; '
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
        str, About("WAV file, one channel per microphone; '' to simulate the sound")
    ] = ''
    sample_rate: Annotated[
        float,
        About('of simulated sound; a recording has its own', 'Hz', minimum=100.0, maximum=1e6),
    ] = 16000.0
    sound_level: Annotated[
        float, About('simulated source: sound pressure at 1 m, RMS', 'Pa', minimum=0.0)
    ] = 1.0
    microphone_noise: Annotated[
        float, About('simulated noise of each microphone, RMS', 'Pa', minimum=0.0)
    ] = 0.02
