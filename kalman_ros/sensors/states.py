# SPDX-License-Identifier: Apache-2.0
"""A sensor of some of the states: GNSS, a tachometer, a joint encoder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from kalman_ros.core import About, Array, Sensor, Space, variances


class States(Sensor):
    """y = some of the states, by name.

    Parameters
    ----------
    state
        The space of the state.
    noise
        Standard deviation of each coordinate, in its unit.
    measures
        The names of the measured states.
    """

    linear = True

    def __init__(
        self,
        state: Space,
        noise: Sequence[float],
        measures: Annotated[Sequence[str], About('states read')] = ('',),
    ) -> None:
        self._indices = np.array(state.indices(measures, 'measures'), dtype=np.intp)
        self.output = state.select(measures)
        self.covariance = variances('noise', noise, self.output.size)
        self._jacobian = np.asfortranarray(np.eye(state.size)[self._indices])

    def measure(self, x: Array) -> Array:
        """Return the measured states."""
        return x.take(self._indices, -1)

    def jacobian(self, x: Array) -> Array:
        """Return the rows of the identity that select the measured states."""
        return self._jacobian


SENSOR = States
