# SPDX-License-Identifier: Apache-2.0
"""A robot with two driven wheels: odometry and a gyroscope, with or without known commands."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Space, coordinates, following

from .turn_rate import TurnRate


class Commanded(TurnRate):
    """The unicycle whose speed and yaw rate follow commands: v' = (v_c - v) / T, likewise omega'.

    T is the time constant of the controllers of the wheels, taken as first-order lags (R.
    Siegwart, I. Nourbakhsh and D. Scaramuzza, Introduction to Autonomous Mobile Robots, 2nd ed.,
    section 3.2, for the kinematics).
    """

    input = Space(('v', 'omega'), ('m/s', 'rad/s'))

    def __init__(self, acceleration_noise: float, turn_noise: float, command_time: float) -> None:
        super().__init__(acceleration_noise, turn_noise)
        self._pull = following(command_time)
        self.max_step = min(self.max_step, 0.5 * command_time)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity, and the approach of speed and turn rate to the commands."""
        rates = super().derivative(x, u)
        _, _, v, _, omega = coordinates(x)
        commanded = coordinates(u)
        rates[..., 2] = self._pull * (commanded[0] - v)
        rates[..., 4] = self._pull * (commanded[1] - omega)
        return rates

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the Jacobian of the unicycle, with the decay of speed and turn rate."""
        A = super().state_jacobian(x, u)
        A[..., 2, 2] = A[..., 4, 4] = -self._pull
        return A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the two accelerations by the commands."""
        B = np.zeros((*x.shape, 2))
        B[..., 2, 0] = B[..., 4, 1] = self._pull
        return B


def diff_drive(
    acceleration_noise: Annotated[
        float, About('spectral density of the acceleration', 'm^2/s^3', minimum=0.0)
    ] = 0.02,
    turn_noise: Annotated[
        float, About('spectral density of the change of yaw rate', 'rad^2/s^3', minimum=0.0)
    ] = 0.02,
    command_time: Annotated[
        float, About('lag behind commands, the input cmd_vel; 0: no input', 's', minimum=0.0)
    ] = 0.0,
) -> TurnRate:
    """Return a unicycle with random changes of speed and yaw rate, a `TurnRate`.

    The commands need not be known, since the wheels measure the speed; with a ``command_time``
    they are the input. The position follows by dead reckoning, with a growing covariance.
    """
    if command_time:
        return Commanded(acceleration_noise, turn_noise, command_time)
    return TurnRate(acceleration_noise, turn_noise)


MODEL = diff_drive
