# SPDX-License-Identifier: Apache-2.0
"""Something that is tracked in the plane and keeps its speed and its turn rate (CTRV)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Model, Signal, Space, System

from ._lidar_radar import lidar_and_radar


class TurnRate(Model):
    """x' = v cos psi, y' = v sin psi, psi' = omega, with noise on v' and omega'.

    R. Schubert, E. Richter and G. Wanielik, Comparison and Evaluation of Advanced Motion Models
    for Vehicle Tracking, FUSION 2008, section II.
    """

    state = Space(
        ('x', 'y', 'v', 'psi', 'omega'), ('m', 'm', 'm/s', 'rad', 'rad/s'), angles=('psi',)
    )
    input = Space((), ())
    max_step = 0.05

    def __init__(
        self,
        acceleration_noise: Annotated[
            float, About('spectral density of the acceleration', 'm^2/s^3', minimum=0.0)
        ] = 0.05,
        turn_noise: Annotated[
            float, About('spectral density of the change of turn rate', 'rad^2/s^3', minimum=0.0)
        ] = 0.02,
    ) -> None:
        self._noise = np.diag([0.0, 0.0, acceleration_noise, 0.0, turn_noise])

    def derivative(self, x: Array, u: Array) -> Array:
        """Return the velocity, and no change of speed and turn rate."""
        _, _, v, psi, omega = np.moveaxis(x, -1, 0)
        still = np.zeros_like(v)
        return np.stack((v * np.cos(psi), v * np.sin(psi), still, omega, still), axis=-1)

    def state_jacobian(self, x: Array, u: Array) -> Array:
        """Return how speed and heading turn the velocity, and omega the heading."""
        _, _, v, psi, _ = x
        A = np.zeros((5, 5))
        A[:2, 2] = np.cos(psi), np.sin(psi)
        A[:2, 3] = -v * np.sin(psi), v * np.cos(psi)
        A[3, 4] = 1.0
        return A

    def noise_density(self, x: Array) -> Array:
        """Return the noise of acceleration and turn rate."""
        return self._noise


SYSTEM = System(
    build=TurnRate,
    sensors=lidar_and_radar(['x', 'y', 'v', 'psi']),
    state=Signal(
        'estimate',
        'nav_msgs/Odometry',
        (
            'pose.pose.position.x',
            'pose.pose.position.y',
            'twist.twist.linear.x',
            'pose.pose.orientation.yaw',
            'twist.twist.angular.z',
        ),
    ),
    initial_state=(20.0, 10.0, 3.0, 1.0, 0.2),
    # a heading that is known no better than to a radian has no Gaussian belief with a range rate
    initial_estimate=(20.0, 10.0, 2.5, 0.8, 0.1),
    initial_std=(0.5, 0.5, 0.5, 0.2, 0.2),
    filter='ukf',
)
