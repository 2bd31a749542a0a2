# SPDX-License-Identifier: Apache-2.0
"""A robot on two driven wheels: its odometry and its gyroscope, and no idea of its commands."""

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
    """Return a unicycle whose speed and yaw rate wander: `TurnRate`, as a robot's own motion.

    What drives it need not be known, since the wheels say how fast it goes. Where it is follows
    from that by dead reckoning, with a covariance that grows as it should.
    """
    return TurnRate(acceleration_noise, turn_noise)


MODEL = diff_drive
