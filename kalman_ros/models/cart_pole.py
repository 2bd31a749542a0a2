# SPDX-License-Identifier: Apache-2.0
"""A pole balanced on a cart that is pushed by a force."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space, from_coordinates
from kalman_ros.linear.views import coordinates, entries_last


class CartPole(Model):
    """The cart-pole of the control tutorials of the University of Michigan.

        (M + m) x'' + b x' - m l theta'' cos theta + m l theta'^2 sin theta = f
        (I + m l^2) theta'' - m g l sin theta = m l x'' cos theta

    theta is 0 upright, and positive where the pole leans towards -x: a forward push increases
    it. Its parameters are those of the tutorial; a random force and a random torque are added.
    """

    state = Space(('x', 'v', 'theta', 'omega'), ('m', 'm/s', 'rad', 'rad/s'), angles=('theta',))
    input = Space(('f',), ('N',))
    max_step = 0.01

    def __init__(
        self,
        cart_mass: Annotated[float, About('mass of the cart', 'kg', minimum=1e-9)] = 0.5,
        pole_mass: Annotated[float, About('mass of the pole', 'kg', minimum=1e-9)] = 0.2,
        friction: Annotated[float, About('friction of the cart', 'N s/m')] = 0.1,
        inertia: Annotated[
            float, About('inertia of the pole about its centre', 'kg m^2', minimum=0.0)
        ] = 0.006,
        length: Annotated[
            float, About('from the pivot to the centre of the pole', 'm', minimum=1e-9)
        ] = 0.3,
        gravity: Annotated[float, About('acceleration of gravity', 'm/s^2')] = 9.8,
        force_noise: Annotated[
            float, About('spectral density of the random force', 'N^2 s', minimum=0.0)
        ] = 0.001,
        torque_noise: Annotated[
            float, About('spectral density of the random torque', '(N m)^2 s', minimum=0.0)
        ] = 1e-5,
    ) -> None:
        self._friction = friction
        self._mass = cart_mass + pole_mass
        self._moment = pole_mass * length
        self._inertia = inertia + pole_mass * length**2
        self._gravity = gravity
        self._noise = force_noise, torque_noise

    def _compliance(self, cosine: Array) -> tuple[Array, Array, Array]:
        """Return the inverse of the mass matrix, [[J, c], [c, M]] / determinant: J, c and M."""
        c = self._moment * cosine
        scale = 1.0 / (self._mass * self._inertia - c * c)
        return self._inertia * scale, c * scale, self._mass * scale

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities, and the accelerations of the class's two equations."""
        _, v, theta, omega = coordinates(x)
        sine = self._moment * np.sin(theta)
        force = u[..., 0] - self._friction * v - omega * omega * sine
        torque = self._gravity * sine
        J, c, M = self._compliance(np.cos(theta))
        return from_coordinates(v, J * force + c * torque, omega, c * force + M * torque)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the derivatives of the class's two equations, solved for the accelerations."""
        _, v, theta, omega = coordinates(x)
        cosine, sine = np.cos(theta), self._moment * np.sin(theta)
        J, c, M = self._compliance(cosine)
        cosine = self._moment * cosine
        force = u[..., 0] - self._friction * v - omega * omega * sine
        torque = self._gravity * sine
        a, alpha = J * force + c * torque, c * force + M * torque
        force, torque = -omega * omega * cosine - alpha * sine, self._gravity * cosine - a * sine
        A = np.zeros((4, 4, *np.shape(force)))
        A[0, 1] = A[2, 3] = 1.0
        A[1, 1], A[3, 1] = -self._friction * J, -self._friction * c
        A[1, 2], A[3, 2] = J * force + c * torque, c * force + M * torque
        by_speed = -2.0 * omega * sine
        A[1, 3], A[3, 3] = J * by_speed, c * by_speed
        return entries_last(A)

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the accelerations of cart and pole by the force."""
        J, c, _ = self._compliance(np.cos(x[..., 2]))
        B = np.zeros((4, 1, *np.shape(J)))
        B[1, 0], B[3, 0] = J, c
        return entries_last(B)

    def noise_density(self, x: Array) -> Array:
        """Return the velocity changes by the random force and torque."""
        J, c, M = self._compliance(np.cos(x[..., 2]))
        force, torque = self._noise
        o, both = 0.0 * c, c * (J * force + M * torque)
        v, omega = J * J * force + c * c * torque, c * c * force + M * M * torque
        W = [[o, o, o, o], [o, v, o, both], [o, o, o, o], [o, both, o, omega]]
        return entries_last(np.array(W))


MODEL = CartPole
