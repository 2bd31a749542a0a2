# SPDX-License-Identifier: Apache-2.0
"""Reset of states by name on ``~/set_state``."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.messages import decode, message_type
from kalman_ros.core import Gaussian, is_finite
from kalman_ros.scenario import Scenario

TYPE = 'sensor_msgs/JointState'


class StateReader:
    """Reader of states: ``name``, their values in ``position``, deviations in ``effort`` if any.

    Parameters
    ----------
    scenario
        Scenario of the estimator, whose states include the biases of sensors.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._space = scenario.believed.model.state
        self.message_type = message_type(TYPE)

    def __call__(self, data: bytes, initial: Gaussian) -> Gaussian:
        """Return the ``initial`` belief with these states and their variances.

        Raises
        ------
        ValueError
            If a name is unknown or repeated, or numbers are missing, not finite or negative.
        """
        message = decode(data, self.message_type)
        names = list(message.name)
        values, std = np.array(message.position), np.array(message.effort)
        indices = self._space.indices(names, 'name')
        if not names or len({*names}) < len(names):
            raise ValueError(f'name: expected names that do not repeat, got {names}')
        if len(values) != len(names) or len(std) not in (0, len(names)):
            raise ValueError(
                f'expected {len(names)} values in position, and as many or no deviations in '
                f'effort, got {len(values)} and {len(std)}'
            )
        if not (is_finite(values) and is_finite(std) and np.all(std >= 0.0)):
            raise ValueError('expected finite numbers, and deviations of 0 or more')
        mean, P = initial.mean.copy(), initial.covariance.copy()
        mean[indices] = values
        if len(std):
            P[indices, :] = 0.0
            P[:, indices] = 0.0
            P[indices, indices] = std**2
        return Gaussian(self._space.wrap(mean), P)
