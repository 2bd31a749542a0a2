# SPDX-License-Identifier: Apache-2.0
"""A pole that stands on a cart and falls unless the cart, pushed by a force, keeps under it."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Space


class CartPole(Model):
    """The cart-pole of the control tutorials of the University of Michigan.

        (M + m) x'' + b x' - m l theta'' cos theta + m l theta'^2 sin theta = f
        (I + m l^2) theta'' - m g l sin theta = m l x'' cos theta

    theta is 0 upright, and positive where the pole leans towards -x: a push forwards makes it
    grow. Its parameters are those of the tutorial; a random force and a random torque are added.
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
        self._weight = self._moment * gravity
        self._noise = np.diag([force_noise, torque_noise])

    def _compliance(self, theta: Array) -> Array:
        """Return the inverse of the mass matrix (..., 2, 2): forces to accelerations."""
        M, J, c = self._mass, self._inertia, self._moment * np.cos(theta)
        rows = np.stack((J + 0.0 * c, c, c, M + 0.0 * c), axis=-1)
        inverse: Array = rows / (M * J - c**2)[..., np.newaxis]
        return inverse.reshape(*theta.shape, 2, 2)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities, and the accelerations of the class's two equations."""
        _, v, theta, omega = np.moveaxis(x, -1, 0)
        sine = np.sin(theta)
        force = u[..., 0] - self._friction * v - self._moment * omega**2 * sine
        loads = np.stack((force, self._weight * sine), axis=-1)
        a = np.einsum('...ij,...j->...i', self._compliance(theta), loads)
        return np.stack((v, a[..., 0], omega, a[..., 1]), axis=-1)

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return how the force accelerates cart and pole."""
        B = np.zeros((4, 1))
        B[1::2, 0] = self._compliance(x[..., 2])[:, 0]
        return B

    def noise_density(self, x: Array) -> Array:
        """Return what the random force and torque do to the velocities."""
        H = self._compliance(x[..., 2])
        W = np.zeros((4, 4))
        W[1::2, 1::2] = H @ self._noise @ H.T
        return W


MODEL = CartPole
