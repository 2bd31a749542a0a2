# SPDX-License-Identifier: Apache-2.0
"""Reset of the state to a pose on ``initialpose``, as published by RViz."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Gaussian, Signal, is_finite, semidefinite
from kalman_ros.scenario import Scenario

_TYPE = 'geometry_msgs/PoseWithCovarianceStamped'


class PoseReader:
    """Reader of a pose, which replaces the coordinates of a state that it contains.

    Those are the coordinates whose field in the state's message begins with ``pose.``; a state
    without any is refused.
    """

    def __init__(self, scenario: Scenario) -> None:
        fields = scenario.state.fields
        self._pose = [i for i, field in enumerate(fields) if field.startswith('pose.pose.')]
        paths = tuple(fields[index] for index in self._pose)
        codec = SignalCodec(Signal('initialpose', _TYPE, paths or ('pose.pose.position.x',)))
        self._read = WireReader(codec)
        self.message_type = codec.message_type

    def __call__(self, data: bytes, initial: Gaussian) -> Gaussian:
        """Return the ``initial`` belief with the pose and its covariance.

        Raises
        ------
        ValueError
            If the state has no pose, or the pose is not finite, or its covariance is not definite.
        """
        _, values, covariance = self._read(data)
        if not self._pose:
            raise ValueError('the state of this model has no pose')
        if not is_finite(values):
            raise ValueError('expected finite numbers')
        k = len(self._pose)
        R = semidefinite('covariance', covariance, k, definite=True)  # type: ignore[arg-type]
        mean, P = initial.mean.copy(), initial.covariance.copy()
        mean[self._pose] = values
        P[self._pose, :] = 0.0
        P[:, self._pose] = 0.0
        P[np.ix_(self._pose, self._pose)] = R
        return Gaussian(mean, P)
