# SPDX-License-Identifier: Apache-2.0
"""The options of the microphone array beside the scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About
from kalman_ros.pipeline.estimator_options import Frame, Lockstep, NodeOptions


@dataclass(frozen=True)
class MicrophoneArrayOptions(NodeOptions):
    """Options of the microphone array."""

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
