# SPDX-License-Identifier: Apache-2.0
"""Two electrical currents, where one sensor measures the sum."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, LinearSystem, Space


def current_sensors(
    main_resistance: Annotated[
        float, About('resistance of the main motor', 'Ohm', minimum=1e-9)
    ] = 0.5,
    main_inductance: Annotated[
        float, About('inductance of the main motor', 'H', minimum=1e-9)
    ] = 0.1,
    thruster_resistance: Annotated[
        float, About('resistance of the thruster', 'Ohm', minimum=1e-9)
    ] = 1.0,
    thruster_inductance: Annotated[
        float, About('inductance of the thruster', 'H', minimum=1e-9)
    ] = 0.1,
    voltage_noise: Annotated[
        float, About('spectral density of the random voltage on each', 'V^2 s', minimum=0.0)
    ] = 0.01,
) -> LinearSystem:
    """Return L di/dt + R i = u + w for the main motor and for the thruster.

    Each current follows its voltage as a first-order lag with the time constant L / R. The
    sensors measure i_m + i_t and i_t, so C = [[1, 1], [0, 1]] can be inverted: C^-1 y
    is an estimate without dynamics, and as noisy as the sensors.
    """
    R = np.array([main_resistance, thruster_resistance])
    L = np.array([main_inductance, thruster_inductance])
    return LinearSystem(
        A=np.diag(-R / L),
        B=np.diag(1.0 / L),
        W=np.diag(voltage_noise / L**2),
        state=Space(('i_m', 'i_t'), ('A', 'A')),
        input=Space(('u_m', 'u_t'), ('V', 'V')),
    )


MODEL = current_sensors
