# SPDX-License-Identifier: Apache-2.0
"""Comparison of analytical Jacobians with numerical derivatives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Model, Sensor
from kalman_ros.scenario import Scenario

#: A difference below this share of the largest entry may be an error of the numerical derivative.
_TOLERANCE = 1e-3


def wrong_jacobians(scenario: Scenario) -> Iterator[str]:
    """Yield a sentence for each Jacobian that is wrong at the initial belief.

    Each Jacobian is compared with finite differences of ``derivative`` or ``measure``, since a
    filter with a wrong Jacobian gives wrong results without any other symptom.
    """
    model, x = scenario.model, scenario.initial_belief.mean
    states = model.state.names
    if isinstance(model, Model):
        u = model.equilibrium.input
        yield from _compare(
            "The model's state_jacobian",
            "'derivative'",
            (states, states),
            model.state_jacobian(x, u),
            Model.state_jacobian(model, x, u),
        )
        yield from _compare(
            "The model's input_jacobian",
            "'derivative'",
            (states, model.input.names),
            model.input_jacobian(x, u),
            Model.input_jacobian(model, x, u),
        )
    for name, source in scenario.sensors.items():
        sensor = source.sensor
        yield from _compare(
            f'The jacobian of {name}',
            "'measure'",
            (sensor.output.names, states),
            sensor.jacobian(x),
            Sensor.jacobian(sensor, x),
        )


def _compare(
    subject: str,
    function: str,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    analytical: Array,
    numerical: Array,
) -> Iterator[str]:
    difference = np.abs(analytical - numerical)
    if not difference.size or not difference.max() > _TOLERANCE * np.abs(numerical).max():
        return
    row, column = np.unravel_index(np.argmax(difference), difference.shape)
    yield (
        f'{subject} is not the derivative of {function} at the first belief: that of '
        f'{names[0][row]} by {names[1][column]} is {analytical[row, column]:.4g}, and should be '
        f'{numerical[row, column]:.4g}.'
    )
