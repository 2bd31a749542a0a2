# SPDX-License-Identifier: Apache-2.0
"""The model of a quadrotor in a vertical plane."""

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Model, OperatingPoint, Space

GRAVITY = 9.81


class Quadrotor(Model):
    """A rigid body with a thrust T along its own axis, a torque tau, and linear drag b.

    m x'' = T sin pitch - b x',  m z'' = T cos pitch - b z' - m g,  J pitch'' = tau.
    """

    state = Space(
        ('x', 'z', 'pitch', 'vx', 'vz', 'q'),
        ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s'),
        angles=('pitch',),
    )
    input = Space(('thrust', 'torque'), ('N', 'N m'))
    max_step = 0.01

    def __init__(
        self,
        mass: Annotated[float, About('mass', 'kg', minimum=1e-9)] = 1.0,
        inertia: Annotated[float, About('moment of inertia', 'kg m^2', minimum=1e-9)] = 0.01,
        drag: Annotated[float, About('drag of the air', 'N s/m')] = 0.0,
        thrust_noise: Annotated[float, About('random thrust', 'N^2 s', minimum=0.0)] = 0.01,
        torque_noise: Annotated[float, About('random torque', '(N m)^2 s', minimum=0.0)] = 1e-5,
        force_noise: Annotated[float, About('wind', 'N^2 s', minimum=0.0)] = 1e-6,
    ):
        self.mass, self.inertia, self.drag = mass, inertia, drag
        self.noise = thrust_noise, torque_noise, force_noise

    @property
    def equilibrium(self):
        """Hovering at the origin."""
        return OperatingPoint(np.zeros(6), np.array([self.mass * GRAVITY, 0.0]))

    def derivative(self, x, u):
        """Return the velocities and the accelerations."""
        pitch, vx, vz, q = x[..., 2], x[..., 3], x[..., 4], x[..., 5]
        ax = (u[..., 0] * np.sin(pitch) - self.drag * vx) / self.mass
        az = (u[..., 0] * np.cos(pitch) - self.drag * vz) / self.mass - GRAVITY
        return np.stack((vx, vz, q, ax, az, u[..., 1] / self.inertia), axis=-1)

    def noise_density(self, x):
        """Return that of the thrust, along the body, of the wind and of the torque."""
        thrust, torque, wind = self.noise
        sine, cosine = np.sin(x[..., 2]), np.cos(x[..., 2])
        axis = np.stack((sine, cosine), axis=-1)
        W = np.zeros((*x.shape[:-1], 6, 6))
        push = thrust * axis[..., :, None] * axis[..., None, :] + wind * np.eye(2)
        W[..., 3:5, 3:5] = push / self.mass**2
        W[..., 5, 5] = torque / self.inertia**2
        return W
