# SPDX-License-Identifier: Apache-2.0
"""A robot in the plane with nearly constant acceleration and turn rate, whatever drives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space, spectral_densities


class Robot2D(Model):
    """p' = R v, yaw' = w, v' = a - w x v, with noise on w' and a', and on all else if wished.

    R turns the axes of the body, in which velocity v and acceleration a are, into those of the
    world: `Robot3D` in the plane.
    """

    state = Space(
        ('x', 'y', 'yaw', 'vx', 'vy', 'wz', 'ax', 'ay'),
        ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s', 'm/s^2', 'm/s^2'),
        angles=('yaw',),
    )
    input = Space((), ())
    max_step = 0.05

    def __init__(
        self,
        position_noise: Annotated[
            Sequence[float], About('spectral densities of noise on x and y', 'm^2/s')
        ] = (0.0, 0.0),
        heading_noise: Annotated[
            float, About('spectral density of noise on the heading', 'rad^2/s', minimum=0.0)
        ] = 0.0,
        velocity_noise: Annotated[
            Sequence[float], About('spectral densities of noise on the velocity', 'm^2/s^3')
        ] = (0.0, 0.0),
        turn_noise: Annotated[
            float, About('spectral density of the change of turn rate', 'rad^2/s^3', minimum=0.0)
        ] = 0.02,
        acceleration_noise: Annotated[
            Sequence[float], About('spectral densities of the jerk', 'm^2/s^5')
        ] = (0.05, 0.05),
    ) -> None:
        position, velocity, acceleration = np.split(
            spectral_densities(
                2,
                position_noise=position_noise,
                velocity_noise=velocity_noise,
                acceleration_noise=acceleration_noise,
            ),
            3,
        )
        turning = [heading_noise], [turn_noise]
        self._noise = np.diag(
            np.concatenate((position, turning[0], velocity, turning[1], acceleration))
        )

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocity and turn rate in the world, and the change of velocity."""
        _, _, yaw, vx, vy, w, ax, ay = np.moveaxis(x, -1, 0)
        c, s, still = np.cos(yaw), np.sin(yaw), np.zeros_like(w)
        moved = (c * vx - s * vy, s * vx + c * vy, w)
        return np.stack((*moved, ax + w * vy, ay - w * vx, still, still, still), axis=-1)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives by heading, velocity, turn rate and acceleration."""
        _, _, yaw, vx, vy, w, _, _ = np.moveaxis(x, -1, 0)
        c, s = np.cos(yaw), np.sin(yaw)
        A = np.zeros((*x.shape, 8))
        A[..., 0, 2], A[..., 1, 2] = -s * vx - c * vy, c * vx - s * vy
        A[..., 0, 3], A[..., 0, 4], A[..., 1, 3], A[..., 1, 4] = c, -s, s, c
        A[..., 3, 4], A[..., 3, 5], A[..., 4, 3], A[..., 4, 5] = w, vy, -w, -vx
        A[..., 2, 5] = A[..., 3, 6] = A[..., 4, 7] = 1.0
        return A

    def noise_density(self, x: Array) -> Array:
        """Return the noise of each state."""
        return self._noise


MODEL = Robot2D
