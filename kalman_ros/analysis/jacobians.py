# SPDX-License-Identifier: Apache-2.0
"""Analytical Jacobians against the functions that they are derivatives of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Model, Sensor
from kalman_ros.scenario import Scenario

#: A difference below this share of the largest entry may be the numerical one's error.
_TOLERANCE = 1e-3


def wrong_jacobians(scenario: Scenario) -> Iterator[str]:
    """Yield a sentence for each Jacobian that is not a derivative, at the first belief.

    It is compared with differences of ``derivative`` or ``measure``. A filter with a wrong one is
    wrong without any other sign.
    """
    model, x = scenario.model, scenario.initial_belief.mean
    states = model.state.names
    if isinstance(model, Model):
        u = model.equilibrium.input
        yield from _compared(
            "The model's state_jacobian",
            "'derivative'",
            (states, states),
            model.state_jacobian(x, u),
            Model.state_jacobian(model, x, u),
        )
        yield from _compared(
            "The model's input_jacobian",
            "'derivative'",
            (states, model.input.names),
            model.input_jacobian(x, u),
            Model.input_jacobian(model, x, u),
        )
    for name, source in scenario.sensors.items():
        sensor = source.sensor
        yield from _compared(
            f'The jacobian of {name}',
            "'measure'",
            (sensor.output.names, states),
            sensor.jacobian(x),
            Sensor.jacobian(sensor, x),
        )


def _compared(
    what: str, of: str, names: tuple[tuple[str, ...], tuple[str, ...]], own: Array, found: Array
) -> Iterator[str]:
    difference = np.abs(own - found)
    if not difference.size or not difference.max() > _TOLERANCE * np.abs(found).max():
        return
    row, column = np.unravel_index(np.argmax(difference), difference.shape)
    yield (
        f'{what} is not the derivative of {of} at the first belief: that of {names[0][row]} by '
        f'{names[1][column]} is {own[row, column]:.4g}, and should be {found[row, column]:.4g}.'
    )
