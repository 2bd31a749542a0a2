# SPDX-License-Identifier: Apache-2.0
"""Reset of states by name on ``~/set_state``."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.messages import decode, message_type
from kalman_ros.core import Gaussian, is_finite, semidefinite
from kalman_ros.scenario import Scenario

TYPE = 'sensor_msgs/JointState'


class StateReader:
    """Reader of states: ``name``, their values in ``position``, deviations in ``effort`` if any.

    Of n > 1 states, n^2 numbers in ``effort`` are the rows of their covariance.

    Parameters
    ----------
    scenario
        Scenario of the estimator, whose states include the biases of sensors.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._space = scenario.believed.model.state
        self.message_type = message_type(TYPE)

    def __call__(self, data: bytes, initial: Gaussian, _: object = None) -> Gaussian:
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
        if not names:
            raise ValueError('name: expected names of states, got none')
        if len({*names}) < len(names):
            raise ValueError(f'name: expected names that do not repeat, got {names}')
        n = len(names)
        if len(values) != n or len(std) not in (0, n, n * n):
            raise ValueError(
                f'expected {n} values in position, and in effort none, {n} deviations or the '
                f'{n * n} numbers of a covariance, got {len(values)} and {len(std)}'
            )
        if not (is_finite(values) and is_finite(std)):
            raise ValueError('expected finite numbers')
        if len(std) == n and not np.all(std >= 0.0):
            raise ValueError('expected deviations of 0 or more')
        square = len(std) == n * n and n > 1
        block = semidefinite('effort', std, n) if square else np.diag(std**2)
        mean, P = initial.mean.copy(), initial.covariance.copy()
        mean[indices] = values
        if len(std):
            P[indices, :] = 0.0
            P[:, indices] = 0.0
            P[np.ix_(indices, indices)] = block
        return Gaussian(self._space.wrap(mean), P)
