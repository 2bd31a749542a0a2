# SPDX-License-Identifier: Apache-2.0
"""Inertial navigation in space: the readings of an IMU, which has biases, are the input."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, OperatingPoint, Space
from kalman_ros.core import rotations as so3

#: Slices of the state: position, rotation, velocity, biases of gyroscope and accelerometer.
_P, _R, _V, _G, _B = (slice(3 * k, 3 * k + 3) for k in range(5))


class Inertial(Model):
    """p' = v, R' = R [s_g w - b_g]x, v' = R (s_a f - b_a) - (0, 0, g), with noise on all but p.

    R turns the axes of the body into those of the world, in which position and velocity are. The
    biases forget their value with a time constant (P. Groves, Principles of GNSS, Inertial, and
    Multisensor Integrated Navigation Systems, 2013, sections 5.3 and 14.2.3, without the rotation
    of the Earth).
    """

    state = Space(
        tuple(f'{kind}{axis}' for kind in ('', 'r', 'v', 'g', 'b') for axis in 'xyz'),
        ('m',) * 3 + ('rad',) * 3 + ('m/s',) * 3 + ('rad/s',) * 3 + ('m/s^2',) * 3,
        rotations=(('rx', 'ry', 'rz'),),
    )
    input = Space(('wx', 'wy', 'wz', 'fx', 'fy', 'fz'), ('rad/s',) * 3 + ('m/s^2',) * 3)
    max_step = 0.05

    def __init__(
        self,
        gyro_noise: Annotated[
            float, About('spectral density of the angular rates', 'rad^2/s', minimum=0.0)
        ] = 1e-5,
        accelerometer_noise: Annotated[
            float, About('spectral density of the specific forces', 'm^2/s^3', minimum=0.0)
        ] = 1e-3,
        gyro_bias_noise: Annotated[
            float, About('spectral density of the bias of the rates', 'rad^2/s^3', minimum=0.0)
        ] = 1e-8,
        accelerometer_bias_noise: Annotated[
            float, About('spectral density of the bias of the forces', 'm^2/s^5', minimum=0.0)
        ] = 1e-6,
        bias_time: Annotated[
            float, About('time constant of the biases', 's', minimum=1e-3)
        ] = 1000.0,
        gravity: Annotated[
            float, About('acceleration of gravity', 'm/s^2', minimum=0.0)
        ] = 9.80665,
        gyro_scale: Annotated[
            float, About('true rates by those of the readings', minimum=0.1, maximum=10.0)
        ] = 1.0,
        accelerometer_scale: Annotated[
            float, About('the same of the specific forces', minimum=0.1, maximum=10.0)
        ] = 1.0,
    ) -> None:
        noise = (0.0, gyro_noise, accelerometer_noise, gyro_bias_noise, accelerometer_bias_noise)
        self._noise = np.diag(np.repeat(noise, 3))
        self._gravity = np.array([0.0, 0.0, gravity])
        self._decay = 1.0 / bias_time
        self._gyro_scale, self._accelerometer_scale = gyro_scale, accelerometer_scale

    @property
    def equilibrium(self) -> OperatingPoint:
        """Equilibrium at rest and level, where the accelerometer reads gravity, upwards."""
        force = self._gravity / self._accelerometer_scale
        return OperatingPoint(np.zeros(15), np.concatenate((np.zeros(3), force)))

    @property
    def input_scale(self) -> tuple[float, ...]:
        """The scales of gyro and accelerometer."""
        return (self._gyro_scale,) * 3 + (self._accelerometer_scale,) * 3

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocity, angular rate and acceleration in the world; the biases decay."""
        R = so3.exp(x[..., _R])
        rate, force = self._measured(x, u)
        turned = (R @ rate[..., np.newaxis])[..., 0]
        pushed = (R @ force[..., np.newaxis])[..., 0] - self._gravity
        biases = -self._decay * x[..., 9:]
        return np.concatenate((x[..., _V], turned, pushed, biases), axis=-1)

    def _measured(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the angular rate and the specific force (..., 3) in the axes of the body."""
        rate = self._gyro_scale * u[..., :3] - x[..., _G]
        return rate, self._accelerometer_scale * u[..., 3:] - x[..., _B]

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of errors; an error of the rotation turns the specific force."""
        R = so3.exp(x[..., _R])
        force = (R @ self._measured(x, u)[1][..., np.newaxis])[..., 0]
        A = np.zeros((*x.shape, 15))
        A[..., _P, _V] = np.eye(3)
        A[..., _R, _G] = A[..., _V, _B] = -R
        A[..., _V, _R] = -so3.skew(force)
        A[..., 9:, 9:] = -self._decay * np.eye(6)
        return A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives by rates and forces of the body, in the world."""
        B = np.zeros((*x.shape, 6))
        R = so3.exp(x[..., _R])
        B[..., _R, :3], B[..., _V, 3:] = self._gyro_scale * R, self._accelerometer_scale * R
        return B

    def noise_density(self, x: Array) -> Array:
        """Return the noise of the IMU, which is the same about all axes, and of its biases."""
        return self._noise


MODEL = Inertial
