# SPDX-License-Identifier: Apache-2.0
"""A robot in the plane with nearly constant acceleration and turn rate, whatever drives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import (
    About,
    Array,
    Model,
    Space,
    coordinates,
    following,
    from_coordinates,
    spectral_densities,
)


class Robot2D(Model):
    """p' = R v, yaw' = w, v' = a - w x v, with noise on w' and a', and on all else if wished.

    R turns the axes of the body, in which velocity v and acceleration a are, into those of the
    world: `Robot3D` in the plane.

    With a ``command_time`` T the velocity follows commands, which are the input:
    w' = (w_c - w) / T and a' = (4 / T^2) (v_c - v) - (4 / T) v', a critically damped approach
    whose mean delay is T (K. Ogata, Modern Control Engineering, 5th ed., section 5.3).
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
            Sequence[float], About('spectral densities of noise on x and y', 'm^2/s', minimum=0.0)
        ] = (0.0, 0.0),
        heading_noise: Annotated[
            float, About('spectral density of noise on the heading', 'rad^2/s', minimum=0.0)
        ] = 0.0,
        velocity_noise: Annotated[
            Sequence[float],
            About('spectral densities of noise on the velocity', 'm^2/s^3', minimum=0.0),
        ] = (0.0, 0.0),
        turn_noise: Annotated[
            float, About('spectral density of the change of turn rate', 'rad^2/s^3', minimum=0.0)
        ] = 0.02,
        acceleration_noise: Annotated[
            Sequence[float], About('spectral densities of the jerk', 'm^2/s^5', minimum=0.0)
        ] = (0.05, 0.05),
        command_time: Annotated[
            float,
            About('lag behind commands, the input cmd_vel; 0: no input', 's', minimum=0.0),
        ] = 0.0,
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
        self._pull = following(command_time) if command_time else 0.0
        if command_time:
            self.max_step = min(self.max_step, 0.5 * command_time)
            self.input = Space(('vx', 'vy', 'wz'), ('m/s', 'm/s', 'rad/s'))
        turning = [heading_noise], [turn_noise]
        self._noise = np.diag(
            np.concatenate((position, turning[0], velocity, turning[1], acceleration))
        )

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocity and turn rate in the world, and the change of velocity."""
        _, _, yaw, vx, vy, w, ax, ay = coordinates(x)
        c, s, still = np.cos(yaw), np.sin(yaw), np.zeros_like(w)
        moved = (c * vx - s * vy, s * vx + c * vy, w)
        sped = ax + w * vy, ay - w * vx
        if not self._pull:
            return from_coordinates(*moved, *sped, still, still, still)
        k, commanded = self._pull, coordinates(u)
        jerk = [
            4.0 * k * (k * (command - now) - change)
            for command, now, change in zip(commanded, (vx, vy), sped)
        ]
        return from_coordinates(*moved, *sped, k * (commanded[2] - w), *jerk)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives by heading, velocity, turn rate and acceleration."""
        _, _, yaw, vx, vy, w, _, _ = coordinates(x)
        c, s = np.cos(yaw), np.sin(yaw)
        A = np.zeros((*x.shape, 8))
        A[..., 0, 2], A[..., 1, 2] = -s * vx - c * vy, c * vx - s * vy
        A[..., 0, 3], A[..., 0, 4], A[..., 1, 3], A[..., 1, 4] = c, -s, s, c
        A[..., 3, 4], A[..., 3, 5], A[..., 4, 3], A[..., 4, 5] = w, vy, -w, -vx
        A[..., 2, 5] = A[..., 3, 6] = A[..., 4, 7] = 1.0
        k = self._pull
        if k:
            A[..., 6:, :] = -4.0 * k * A[..., 3:5, :]
            A[..., 6, 3] -= 4.0 * k**2
            A[..., 7, 4] -= 4.0 * k**2
            A[..., 5, 5] = -k
        return A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the jerk and of the change of turn rate by the commands."""
        B = np.zeros((*x.shape, self.input.size))
        if self._pull:
            B[..., 6, 0] = B[..., 7, 1] = 4.0 * self._pull**2
            B[..., 5, 2] = self._pull
        return B

    def noise_density(self, x: Array) -> Array:
        """Return the noise of each state."""
        return self._noise


MODEL = Robot2D
