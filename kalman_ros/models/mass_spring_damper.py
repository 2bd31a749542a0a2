# SPDX-License-Identifier: Apache-2.0
"""A mass on a spring and a damper, pushed by a force along one axis."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About, LinearSystem, Space


def mass_spring_damper(
    mass: Annotated[float, About('mass of the body', 'kg', minimum=1e-9)] = 1.0,
    stiffness: Annotated[float, About('stiffness of the spring', 'N/m')] = 2.0,
    damping: Annotated[float, About('damping coefficient', 'N s/m')] = 0.4,
    force_noise: Annotated[
        float, About('spectral density of the random force', 'N^2 s', minimum=0.0)
    ] = 0.1,
) -> LinearSystem:
    """Return m x'' + c x' + k x = f + w, with w a white force.

    A negative stiffness or damping is allowed: it makes the system unstable. Any textbook of
    vibrations has the equation; as a state-space system it is

        d/dt [x, v] = [[0, 1], [-k/m, -c/m]] [x, v] + [0, 1/m] f.
    """
    m, k, c = mass, stiffness, damping
    return LinearSystem(
        A=[[0.0, 1.0], [-k / m, -c / m]],
        B=[[0.0], [1.0 / m]],
        W=[[0.0, 0.0], [0.0, force_noise / m**2]],
        state=Space(('x', 'v'), ('m', 'm/s')),
        input=Space(('f',), ('N',)),
    )


MODEL = mass_spring_damper
