# SPDX-License-Identifier: Apache-2.0
"""A target tracked by its bearing alone, from a vehicle with known acceleration."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kalman_ros.core import About, LinearSystem, Space


def bearing_tracker(
    acceleration_noise: Annotated[
        float,
        About("spectral density of the target's acceleration, each axis", 'm^2/s^3', minimum=0.0),
    ] = 9e-6,
) -> LinearSystem:
    """Return p' = v, v' = w - a: the target relative to the observer, which accelerates by a.

    The axes do not turn with the observer. While the observer keeps its velocity, no
    bearing determines the range; a turn of the observer does (S. Nardone and V. Aidala,
    Observability Criteria for Bearings-Only Target Motion Analysis, IEEE Trans. Aerospace and
    Electronic Systems 17(2), 1981). Until then the range is that of the initial belief.
    """
    zero, one = np.zeros((2, 2)), np.eye(2)
    return LinearSystem(
        A=np.block([[zero, one], [zero, zero]]),
        B=np.vstack((zero, -one)),
        W=np.block([[zero, zero], [zero, acceleration_noise * one]]),
        state=Space(('x', 'y', 'v_x', 'v_y'), ('m', 'm', 'm/s', 'm/s')),
        input=Space(('a_x', 'a_y'), ('m/s^2', 'm/s^2')),
    )


MODEL = bearing_tracker
