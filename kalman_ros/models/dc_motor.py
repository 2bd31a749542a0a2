# SPDX-License-Identifier: Apache-2.0
"""A DC motor with inertia and inductance; an encoder measures only the angle."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, LinearSystem, Space


def dc_motor(
    inertia: Annotated[float, About('inertia of rotor and load', 'kg m^2', minimum=1e-12)] = 0.01,
    friction: Annotated[float, About('viscous friction', 'N m s', minimum=0.0)] = 0.1,
    constant: Annotated[float, About('torque by current', 'N m/A', minimum=1e-12)] = 0.01,
    resistance: Annotated[float, About('of the winding', 'Ohm', minimum=0.0)] = 1.0,
    inductance: Annotated[float, About('of the winding', 'H', minimum=1e-12)] = 0.5,
    torque_noise: Annotated[
        float, About('spectral density of the random load', '(N m)^2 s', minimum=0.0)
    ] = 1e-6,
    voltage_noise: Annotated[
        float, About('spectral density of the random voltage', 'V^2 s', minimum=0.0)
    ] = 1e-4,
) -> LinearSystem:
    """Return J omega' + b omega = K i + w and L i' + R i = u - K omega + v.

    The parameters are those of the control tutorials of the University of Michigan, with poles
    at -9.9975 and -2.0025, and one at 0 for the angle. The angle counts turns,
    theta' = omega.
    """
    J, b, K, R, L = inertia, friction, constant, resistance, inductance
    return LinearSystem(
        A=[[0.0, 1.0, 0.0], [0.0, -b / J, K / J], [0.0, -K / L, -R / L]],
        B=[[0.0], [0.0], [1.0 / L]],
        W=np.diag([0.0, torque_noise / J**2, voltage_noise / L**2]),
        state=Space(('theta', 'omega', 'i'), ('rad', 'rad/s', 'A')),
        input=Space(('u',), ('V',)),
    )


MODEL = dc_motor
