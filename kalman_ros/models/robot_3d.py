# SPDX-License-Identifier: Apache-2.0
"""A robot in space with nearly constant acceleration and turn rate, whatever drives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space, spectral_densities
from kalman_ros.core import rotations as so3

#: Slices of the state: position, rotation, velocity, angular rate, acceleration.
_P, _R, _V, _W, _A = (slice(3 * k, 3 * k + 3) for k in range(5))


class Robot3D(Model):
    """p' = R v, R' = R [w]x, v' = a - w x v, with noise on w' and a', and on all else if wished.

    R turns the axes of the body, in which velocity v, angular rate w and acceleration a are, into
    those of the world. The acceleration is that of the body, without gravity (R. Featherstone,
    Rigid Body Dynamics Algorithms, 2008, section 2.11: the classical and not the spatial one).
    """

    state = Space(
        tuple(f'{kind}{axis}' for kind in ('', 'r', 'v', 'w', 'a') for axis in 'xyz'),
        ('m',) * 3 + ('rad',) * 3 + ('m/s',) * 3 + ('rad/s',) * 3 + ('m/s^2',) * 3,
        rotations=(('rx', 'ry', 'rz'),),
    )
    input = Space((), ())
    max_step = 0.05

    def __init__(
        self,
        position_noise: Annotated[
            Sequence[float],
            About('spectral densities of noise on the position', 'm^2/s', minimum=0.0),
        ] = (0.0, 0.0, 0.0),
        orientation_noise: Annotated[
            Sequence[float],
            About('spectral densities about the axes of the world', 'rad^2/s', minimum=0.0),
        ] = (0.0, 0.0, 0.0),
        velocity_noise: Annotated[
            Sequence[float],
            About('spectral densities of noise on the velocity', 'm^2/s^3', minimum=0.0),
        ] = (0.0, 0.0, 0.0),
        turn_noise: Annotated[
            Sequence[float],
            About('spectral densities of the change of turn rate', 'rad^2/s^3', minimum=0.0),
        ] = (0.001, 0.001, 0.01),
        acceleration_noise: Annotated[
            Sequence[float], About('spectral densities of the jerk', 'm^2/s^5', minimum=0.0)
        ] = (0.05, 0.05, 0.01),
        noise_by_speed: Annotated[
            bool, About('multiply the noise of the pose by the square of the speed')
        ] = False,
    ) -> None:
        self._noise = np.diag(
            spectral_densities(
                3,
                position_noise=position_noise,
                orientation_noise=orientation_noise,
                velocity_noise=velocity_noise,
                turn_noise=turn_noise,
                acceleration_noise=acceleration_noise,
            )
        )
        self._moving = np.diag(np.repeat([1.0, 0.0], (6, 9))) if noise_by_speed else None

    def derivative(self, x: Array, u: Array) -> Array:
        """Return velocity and angular rate in the world, and the change of velocity."""
        v, w, a = x[..., _V], x[..., _W], x[..., _A]
        R, still = so3.exp(x[..., _R]), np.zeros_like(w)
        moved, turned = ((R @ vector[..., np.newaxis])[..., 0] for vector in (v, w))
        return np.concatenate((moved, turned, a - so3.cross(w, v), still, still), axis=-1)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of errors; a rotation error in the world moves by R dw only."""
        v, w = x[..., _V], x[..., _W]
        R = so3.exp(x[..., _R])
        A = np.zeros((*x.shape, 15))
        A[..., _P, _R] = -so3.skew((R @ v[..., np.newaxis])[..., 0])
        A[..., _P, _V] = A[..., _R, _W] = R
        A[..., _V, _V], A[..., _V, _W] = -so3.skew(w), so3.skew(v)
        A[..., _V, _A] = np.eye(3)
        return A

    def noise_density(self, x: Array) -> Array:
        """Return the noise of each state."""
        if self._moving is None:
            return self._noise
        squared = (x[..., 6:12] ** 2).sum(axis=-1)[..., np.newaxis, np.newaxis]
        return np.asarray(self._noise + (squared - 1.0) * (self._noise * self._moving))


MODEL = Robot3D
