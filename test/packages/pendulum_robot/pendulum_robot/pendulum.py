# SPDX-License-Identifier: Apache-2.0
"""A user's model: a damped pendulum that hangs, turned by a motor."""

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Model, Space


class Pendulum(Model):
    """theta'' = -g/l sin(theta) - c theta' + tau / (m l^2)."""

    state = Space(('theta', 'omega'), ('rad', 'rad/s'), angles=('theta',))
    input = Space(('tau',), ('N m',))
    max_step = 0.02

    def __init__(self, length: Annotated[float, About('length', 'm', minimum=1e-3)] = 0.5):
        self.stiffness, self.gain = 9.81 / length, 1.0 / length**2

    def derivative(self, x, u):
        theta, omega = x[..., 0], x[..., 1]
        acceleration = -self.stiffness * np.sin(theta) - 0.2 * omega + self.gain * u[..., 0]
        return np.stack((omega, acceleration), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.05])
