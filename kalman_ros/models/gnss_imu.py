# SPDX-License-Identifier: Apache-2.0
"""Navigation in the plane: occasional positions, a fast IMU, and the biases of the IMU."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space, coordinates, from_coordinates
from kalman_ros.linear.views import entries_last


class GnssImu(Model):
    """x' = v cos psi, y' = v sin psi, psi' = omega, v' = a, and varying biases b of the IMU.

    Acceleration and yaw rate decay, a' = -a / T + w and omega' = -omega / T + w
    (R. Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets,
    IEEE Trans. Aerospace and Electronic Systems 6(4), 1970). The IMU measures a + b_a and
    omega + b_omega. Its readings are readings, not inputs: so they have stamps, gates, a
    covariance from the message and an NIS like others, any number of IMUs works, and the
    simulated vehicle needs no command. The price is two more states and an assumption about
    its manoeuvres.
    """

    state = Space(
        ('x', 'y', 'psi', 'v', 'omega', 'a', 'b_omega', 'b_a'),
        ('m', 'm', 'rad', 'm/s', 'rad/s', 'm/s^2', 'rad/s', 'm/s^2'),
        angles=('psi',),
    )
    input = Space((), ())
    max_step = 0.05

    def __init__(
        self,
        manoeuvre_time: Annotated[
            float, About('time constant of a manoeuvre', 's', minimum=1e-3)
        ] = 2.0,
        acceleration_noise: Annotated[
            float, About('spectral density of the jerk', 'm^2/s^5', minimum=0.0)
        ] = 0.5,
        turn_noise: Annotated[
            float, About('spectral density of the change of yaw rate', 'rad^2/s^3', minimum=0.0)
        ] = 0.02,
        bias_noise: Annotated[
            float, About('spectral density of the bias of acceleration', 'm^2/s^5', minimum=0.0)
        ] = 1e-6,
        gyro_bias_noise: Annotated[
            float, About('spectral density of the bias of yaw rate', 'rad^2/s^3', minimum=0.0)
        ] = 1e-9,
    ) -> None:
        self._decay = 1.0 / manoeuvre_time
        noise = (turn_noise, acceleration_noise, gyro_bias_noise, bias_noise)
        self._noise = np.diag([0.0, 0.0, 0.0, 0.0, *noise])

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the motion of the vehicle; the biases are constant."""
        _, _, psi, v, omega, a, b, _ = coordinates(x)
        still = np.zeros_like(b)
        motion = (v * np.cos(psi), v * np.sin(psi), omega, a)
        dying = (-self._decay * omega, -self._decay * a)
        return from_coordinates(*motion, *dying, still, still)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the velocity by heading and speed, and the constant ones."""
        psi, v = x[..., 2], x[..., 3]
        A = np.zeros((8, 8, *v.shape))
        A[:2, 2] = -v * np.sin(psi), v * np.cos(psi)
        A[:2, 3] = np.cos(psi), np.sin(psi)
        A[2, 4] = A[3, 5] = 1.0
        A[4, 4] = A[5, 5] = -self._decay
        return entries_last(A)

    def noise_density(self, x: Array) -> Array:
        """Return the noise of the manoeuvres and of the biases."""
        return self._noise


MODEL = GnssImu
