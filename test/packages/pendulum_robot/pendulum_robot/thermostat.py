# SPDX-License-Identifier: Apache-2.0
"""A room and its heater in discrete time, as an identification gives them."""

from typing import Annotated

import numpy as np

from kalman_ros.core import About, DiscreteModel, Space


class Thermostat(DiscreteModel):
    """Differences of temperature from outside, five times a second; the heater saturates."""

    state = Space(('room', 'heater'), ('K', 'K'))
    input = Space(('power',), ('W',))
    period = 0.2

    def __init__(self, loss: Annotated[float, About('share lost in a step', minimum=0.0)] = 0.1):
        self.loss = loss

    def next(self, x, u):
        """Return the temperatures one period later."""
        room, heater = x[..., 0], x[..., 1]
        warmed = 4.0 * np.tanh(0.25 * u[..., 0])
        return np.stack(
            ((1.0 - self.loss) * room + self.loss * heater, 0.8 * heater + warmed), axis=-1
        )

    def noise(self, x):
        """Return the covariance that a period adds."""
        return np.diag([1e-3, 1e-2])
