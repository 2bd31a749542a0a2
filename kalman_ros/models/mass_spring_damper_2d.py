# SPDX-License-Identifier: Apache-2.0
"""A mass in a plane, held by a spring and a damper along each axis, pushed by two forces."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About, LinearSystem, SensorSetup, Signal, Space, System


def mass_spring_damper_2d(
    mass: Annotated[float, About('mass of the body', 'kg', minimum=1e-9)] = 1.0,
    stiffness_x: Annotated[float, About('stiffness of the spring along x', 'N/m')] = 2.0,
    stiffness_y: Annotated[float, About('stiffness of the spring along y', 'N/m')] = 1.0,
    damping_x: Annotated[float, About('damping coefficient along x', 'N s/m')] = 0.4,
    damping_y: Annotated[float, About('damping coefficient along y', 'N s/m')] = 0.2,
    force_noise: Annotated[
        float, About('spectral density of the random force on each axis', 'N^2 s', minimum=0.0)
    ] = 0.1,
) -> LinearSystem:
    """Return m x'' + c_x x' + k_x x = f_x + w_x and the same along y, one mass for both."""
    m, w = mass, force_noise / mass**2
    return LinearSystem(
        A=[
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness_x / m, -damping_x / m, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, -stiffness_y / m, -damping_y / m],
        ],
        B=[[0.0, 0.0], [1.0 / m, 0.0], [0.0, 0.0], [0.0, 1.0 / m]],
        W=[[0.0] * 4, [0.0, w, 0.0, 0.0], [0.0] * 4, [0.0, 0.0, 0.0, w]],
        state=Space(('x', 'v_x', 'y', 'v_y'), ('m', 'm/s', 'm', 'm/s')),
        input=Space(('f_x', 'f_y'), ('N', 'N')),
    )


SYSTEM = System(
    build=mass_spring_damper_2d,
    sensors={
        'position': SensorSetup(
            kind='states',
            options={'measures': ['x', 'y']},
            noise=(0.05, 0.05),
            rate=20.0,
            signal=Signal(
                'position',
                'geometry_msgs/PoseWithCovarianceStamped',
                ('pose.pose.position.x', 'pose.pose.position.y'),
            ),
        ),
        'velocity': SensorSetup(
            kind='states',
            options={'measures': ['v_x', 'v_y']},
            noise=(0.5, 0.5),
            rate=100.0,
            signal=Signal(
                'velocity',
                'geometry_msgs/TwistWithCovarianceStamped',
                ('twist.twist.linear.x', 'twist.twist.linear.y'),
            ),
        ),
    },
    state=Signal(
        'estimate',
        'nav_msgs/Odometry',
        (
            'pose.pose.position.x',
            'twist.twist.linear.x',
            'pose.pose.position.y',
            'twist.twist.linear.y',
        ),
    ),
    input=Signal('force', 'geometry_msgs/WrenchStamped', ('wrench.force.x', 'wrench.force.y')),
    state_cost=(20.0, 2.0, 20.0, 2.0),
    input_cost=(1.0, 1.0),
    initial_state=(1.0, 0.0, -0.5, 0.0),
    initial_std=(1.0, 1.0, 1.0, 1.0),
)
