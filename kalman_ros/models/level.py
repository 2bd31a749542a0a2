# SPDX-License-Identifier: Apache-2.0
"""A level that wanders: the least that can be known of any number read with noise."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About, LinearSystem, Space


def level(
    noise_density: Annotated[
        float, About('variance that the level gains in a second', minimum=0.0)
    ] = 0.01,
) -> LinearSystem:
    """Return d level / dt = w, with w white: the local level model, without an input.

    J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods (2012), chapter 2.
    Where the readings are a year apart, let a second stand for a year.
    """
    return LinearSystem([[0.0]], [[]], [[noise_density]], Space(('level',), ('',)), Space((), ()))


MODEL = level
