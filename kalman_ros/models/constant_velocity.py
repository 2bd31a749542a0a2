# SPDX-License-Identifier: Apache-2.0
"""A target in the plane with nearly constant velocity."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, LinearSystem, Space


def constant_velocity(
    acceleration_noise: Annotated[
        float, About('spectral density of the acceleration on each axis', 'm^2/s^3', minimum=0.0)
    ] = 0.45,
) -> LinearSystem:
    """Return p' = v, v' = w along both axes, with w white, and without a known input.

    Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation
    (2001), section 6.2.2.
    """
    zero, one = np.zeros((2, 2)), np.eye(2)
    return LinearSystem(
        A=np.block([[zero, one], [zero, zero]]),
        B=np.zeros((4, 0)),
        W=np.block([[zero, zero], [zero, acceleration_noise * one]]),
        state=Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s')),
        input=Space((), ()),
    )


MODEL = constant_velocity
