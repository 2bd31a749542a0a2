# SPDX-License-Identifier: Apache-2.0
"""A robot with two driven wheels: odometry and a gyroscope, without known commands."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About

from .turn_rate import TurnRate


def diff_drive(
    acceleration_noise: Annotated[
        float, About('spectral density of the acceleration', 'm^2/s^3', minimum=0.0)
    ] = 0.02,
    turn_noise: Annotated[
        float, About('spectral density of the change of yaw rate', 'rad^2/s^3', minimum=0.0)
    ] = 0.02,
) -> TurnRate:
    """Return a unicycle with random changes of speed and yaw rate, a `TurnRate`.

    The commands need not be known, since the wheels measure the speed. The position follows
    by dead reckoning, with a growing covariance.
    """
    return TurnRate(acceleration_noise, turn_noise)


MODEL = diff_drive
