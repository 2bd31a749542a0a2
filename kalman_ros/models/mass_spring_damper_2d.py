# SPDX-License-Identifier: Apache-2.0
"""A mass in a plane, held by a spring and a damper along each axis, pushed by two forces."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About, LinearSystem, Space


def mass_spring_damper_2d(
    mass: Annotated[float, About('mass of the body', 'kg', minimum=1e-9)] = 1.0,
    stiffness_x: Annotated[float, About('stiffness of the spring along x', 'N/m')] = 2.0,
    stiffness_y: Annotated[float, About('stiffness of the spring along y', 'N/m')] = 1.0,
    damping_x: Annotated[float, About('damping coefficient along x', 'N s/m')] = 0.4,
    damping_y: Annotated[float, About('damping coefficient along y', 'N s/m')] = 0.2,
    force_noise: Annotated[
        float, About('spectral density of each force', 'N^2 s', minimum=0.0)
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


MODEL = mass_spring_damper_2d
