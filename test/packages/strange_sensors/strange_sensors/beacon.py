# SPDX-License-Identifier: Apache-2.0
"""The distance to a radio beacon: a user's sensor, written from CONTRIBUTING alone."""

from typing import Annotated

import numpy as np

from kalman_ros.core import About, Sensor, Space, variances


class Beacon(Sensor):
    """d = sqrt((x - x_b)^2 + (y - y_b)^2 + height^2)."""

    def __init__(
        self,
        state,
        noise,
        place: Annotated[tuple[float, float], About('x and y of the beacon', 'm')] = (5.0, -3.0),
        height: Annotated[float, About('of the beacon above the robot', 'm', minimum=0.0)] = 2.0,
    ):
        self._x, self._y = state.indices(('x', 'y'))
        self._place, self._height = place, height
        self.output = Space(('distance',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x):
        dx, dy = x[..., self._x] - self._place[0], x[..., self._y] - self._place[1]
        return np.sqrt(dx**2 + dy**2 + self._height**2)[..., np.newaxis]
