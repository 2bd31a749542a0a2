# SPDX-License-Identifier: Apache-2.0
"""The input of whoever does not act."""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Model


def idle_input(model: Model, choice: str) -> Array:
    """Return the input (m,) that a plant gets while no controller acts.

    Parameters
    ----------
    model
        The system.
    choice
        ``zero``, or ``equilibrium`` for the input that holds the model's equilibrium, as that of
        a vehicle that hovers.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if choice == 'zero':
        return np.zeros(model.input.size)
    if choice == 'equilibrium':
        return model.equilibrium.input
    raise ValueError(f"idle_input: expected zero or equilibrium, got '{choice}'")
