# SPDX-License-Identifier: Apache-2.0
"""A random-walk level: the simplest model of a number measured with noise."""

from __future__ import annotations

from typing import Annotated

from kalman_ros.core import About, LinearSystem, Space


def level(
    noise_density: Annotated[
        float, About('growth of the variance of the level in a second', minimum=0.0)
    ] = 0.01,
    unit: Annotated[str, About('unit of the level, for tables and pictures')] = '',
) -> LinearSystem:
    """Return d level / dt = w, with w white: the local level model, without an input.

    J. Durbin and S. J. Koopman, Time Series Analysis by State Space Methods (2012), chapter 2.
    Where the readings are yearly, let a second stand for a year.
    """
    return LinearSystem(
        [[0.0]], [[]], [[noise_density]], Space(('level',), (unit,)), Space((), ())
    )


MODEL = level
