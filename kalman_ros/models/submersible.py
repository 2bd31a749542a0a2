# SPDX-License-Identifier: Apache-2.0
"""A submersible in the vertical plane: surge, heave and pitch, driven by three thrusters."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import (
    About,
    Array,
    Model,
    OperatingPoint,
    Space,
    coordinates,
    from_coordinates,
)
from kalman_ros.linear.views import entries_last


class Submersible(Model):
    """A rigid body in water, after T. I. Fossen, Handbook of Marine Craft Hydrodynamics (2011).

    Position x, z and pitch are in the world, with z up; surge u, heave w and the pitch rate q are
    along the body's axes. With REP-103 axes pitch is positive nose down. M v' + C(v) v + D(v) v
    = thrust + buoyancy, with a diagonal M that includes added mass, linear and quadratic drag,
    and a righting moment since the buoyancy acts above the centre of gravity. The inputs are the
    thrusts of one thruster along the body, and of two upward ones, fore and aft.

    An attitude as roll, pitch and yaw represents pitch only within +-90 degrees.
    """

    state = Space(
        ('x', 'z', 'pitch', 'u', 'w', 'q'),
        ('m', 'm', 'rad', 'm/s', 'm/s', 'rad/s'),
        angles=('pitch',),
    )
    input = Space(('surge', 'fore', 'aft'), ('N', 'N', 'N'))
    max_step = 0.05

    def __init__(
        self,
        surge_mass: Annotated[float, About('mass in surge, water too', 'kg', minimum=1e-9)] = 35.0,
        heave_mass: Annotated[float, About('mass in heave, water too', 'kg', minimum=1e-9)] = 55.0,
        pitch_inertia: Annotated[
            float, About('moment of inertia, water too', 'kg m^2', minimum=1e-9)
        ] = 4.0,
        linear_drag: Annotated[
            float, About('drag of surge and heave', 'N s/m', minimum=0.0)
        ] = 8.0,
        quadratic_drag: Annotated[
            float, About('drag of surge and heave', 'N s^2/m^2', minimum=0.0)
        ] = 40.0,
        angular_drag: Annotated[float, About('drag of pitch', 'N m s', minimum=0.0)] = 1.0,
        quadratic_angular_drag: Annotated[
            float, About('drag of pitch', 'N m s^2', minimum=0.0)
        ] = 4.0,
        buoyancy: Annotated[float, About('buoyancy less weight', 'N')] = 5.0,
        righting_moment: Annotated[float, About('weight times metacentric height', 'N m')] = 10.0,
        arm: Annotated[
            float, About('from the centre to the thrusters fore and aft', 'm', minimum=1e-9)
        ] = 0.4,
        force_noise: Annotated[
            float, About('spectral density of the random forces', 'N^2 s', minimum=0.0)
        ] = 0.5,
        moment_noise: Annotated[
            float, About('spectral density of the random moment', '(N m)^2 s', minimum=0.0)
        ] = 0.01,
    ) -> None:
        self._inertia = np.array([surge_mass, heave_mass, pitch_inertia])
        self._linear = np.array([linear_drag, linear_drag, angular_drag])
        self._quadratic = np.array([quadratic_drag, quadratic_drag, quadratic_angular_drag])
        self._buoyancy, self._righting = buoyancy, righting_moment
        self._thrusters = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, -arm, arm]])
        noise = np.array([force_noise, force_noise, moment_noise])
        self._noise = np.diag([0.0, 0.0, 0.0, *(noise / self._inertia**2)])

    @property
    def equilibrium(self) -> OperatingPoint:
        """Equilibrium at the origin and level, where the vertical thrusters balance buoyancy."""
        return OperatingPoint(np.zeros(6), np.array([0.0, -0.5, -0.5]) * self._buoyancy)

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocities in the world, and the accelerations along the body's axes."""
        sine, cosine = np.sin(x[..., 2]), np.cos(x[..., 2])
        nu = x[..., 3:]
        surge, heave, q = coordinates(nu)
        m_x, m_z, _ = self._inertia
        velocity = (surge * cosine + heave * sine, heave * cosine - surge * sine, q)
        coriolis = (m_z * heave * q, -m_x * surge * q, (m_x - m_z) * surge * heave)
        lift = (-self._buoyancy * sine, self._buoyancy * cosine, -self._righting * sine)
        force = u @ self._thrusters.T + from_coordinates(*lift) - from_coordinates(*coriolis)
        force = force - (self._linear + self._quadratic * np.abs(nu)) * nu
        return np.concatenate((from_coordinates(*velocity), force / self._inertia), axis=-1)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return the Jacobian of `derivative`; the derivative of l v + d |v| v is l + 2 d |v|."""
        sine, cosine = np.sin(x[..., 2]), np.cos(x[..., 2])
        surge, heave, q = coordinates(x[..., 3:])
        m_x, m_z, _ = self._inertia
        A = np.zeros((6, 6, *q.shape))
        A[0, 2:5] = heave * cosine - surge * sine, cosine, sine
        A[1, 2:5] = -heave * sine - surge * cosine, -sine, cosine
        A[2, 5] = 1.0
        A[3, 2], A[3, 4:] = -self._buoyancy * cosine, (-m_z * q, -m_z * heave)
        A[4, 2], A[4, 3], A[4, 5] = -self._buoyancy * sine, m_x * q, m_x * surge
        A[5, 2] = -self._righting * cosine
        A[5, 3:5] = (m_z - m_x) * heave, (m_z - m_x) * surge
        drag = self._linear + 2.0 * self._quadratic * np.abs(x[..., 3:])
        A = entries_last(A)
        A[..., [3, 4, 5], [3, 4, 5]] -= drag
        A[..., 3:, :] /= self._inertia[:, np.newaxis]
        return A

    def input_jacobian(self, x: Array, u: Array) -> Array:
        """Return the velocity changes by the thrusters."""
        return np.vstack((np.zeros((3, 3)), self._thrusters / self._inertia[:, np.newaxis]))

    def noise_density(self, x: Array) -> Array:
        """Return the velocity changes by random forces and moments."""
        return self._noise


MODEL = Submersible
