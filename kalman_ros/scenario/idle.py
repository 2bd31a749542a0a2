# SPDX-License-Identifier: Apache-2.0
"""The input while no controller acts."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Dynamics


def idle_input(model: Dynamics, choice: str) -> Array:
    """Return the input (m,) of a plant while no controller acts.

    Parameters
    ----------
    model
        The system.
    choice
        ``zero``, or ``equilibrium`` for the input that holds the model's equilibrium, such as
        of a hovering vehicle.

    Raises
    ------
    ValueError
        If the choice is neither.
    """
    if choice == 'zero':
        return np.zeros(model.input.size)
    if choice == 'equilibrium':
        return model.equilibrium.input
    raise ValueError(f"idle_input: expected zero or equilibrium, got '{choice}'")


def idle_name(input: Array) -> str:
    """Return an idle input (m,) in words."""
    return "the equilibrium's" if input.any() else 'zero'
