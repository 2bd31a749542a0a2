# SPDX-License-Identifier: Apache-2.0
"""A robot in the plane with nearly constant acceleration and turn rate, whatever drives it."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
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
    whose mean delay is T (K. Ogata, Modern Control Engineering, 5th ed., section 5.3). With
    ``acceleration_limits`` the differences from the commands are cut to T times these, so that
    w' and, in a long approach, v' stay below them.
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
            float, About('lag behind commands, the input cmd_vel; 0: no input', 's', minimum=0.0)
        ] = 0.0,
        acceleration_limits: Annotated[
            Sequence[float],
            About('largest accelerations by commands: forward, left in m/s^2, turn in rad/s^2'),
        ] = (inf, inf, inf),
        noise_by_speed: Annotated[
            bool, About('multiply the noise on position and heading by the square of the speed')
        ] = False,
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
        limits = np.array(acceleration_limits, dtype=float)
        if limits.shape != (3,) or not np.all(limits > 0.0):
            raise ValueError(f'acceleration_limits: expected 3 positive numbers, got {limits}')
        self._limited = bool(np.isfinite(limits).any())
        #: Largest differences from a command that are followed.
        self._reach = limits * command_time if command_time else limits
        self._moving = np.diag(np.repeat([1.0, 0.0], (3, 5))) if noise_by_speed else None
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
        if not self.input.size:
            return from_coordinates(*moved, *sped, still, still, still)
        k = self._pull
        short = u - x[..., 3:6]
        if self._limited:
            short = np.clip(short, -self._reach, self._reach)
        forward, left, turn = coordinates(short)
        jerk = (4.0 * k * (k * forward - sped[0]), 4.0 * k * (k * left - sped[1]))
        return from_coordinates(*moved, *sped, k * turn, *jerk)

    def _followed(self, x: Array, u: Array) -> Array:
        """Return (..., 3) 1 where a command is followed in proportion, 0 beyond the limits."""
        return np.where(np.abs(u - x[..., 3:6]) < self._reach, 1.0, 0.0)

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
        if self.input.size:
            forward, left, turn = coordinates(self._followed(x, u))
            A[..., 6:, :] = -4.0 * k * A[..., 3:5, :]
            A[..., 6, 3] -= 4.0 * k**2 * forward
            A[..., 7, 4] -= 4.0 * k**2 * left
            A[..., 5, 5] = -k * turn
        return A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the jerk and of the change of turn rate by the commands."""
        B = np.zeros((*x.shape, self.input.size))
        if self.input.size:
            forward, left, turn = coordinates(self._followed(x, u))
            B[..., 6, 0], B[..., 7, 1] = 4.0 * self._pull**2 * forward, 4.0 * self._pull**2 * left
            B[..., 5, 2] = self._pull * turn
        return B

    def noise_density(self, x: Array) -> Array:
        """Return the noise of each state."""
        if self._moving is None:
            return self._noise
        squared = (x[..., 3:6] ** 2).sum(axis=-1)[..., np.newaxis, np.newaxis]
        return np.asarray(self._noise + (squared - 1.0) * (self._noise * self._moving))


MODEL = Robot2D
