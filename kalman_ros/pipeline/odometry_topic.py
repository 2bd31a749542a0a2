# SPDX-License-Identifier: Apache-2.0
"""The estimate as ``nav_msgs/Odometry`` on ``estimate/odometry``, whatever its own message is."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Gaussian, Signal
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

#: The field of each role; a velocity is along the axes of the body where the rate is known, too.
_POSE = {
    **{axis: f'pose.pose.position.{axis}' for axis in 'xyz'},
    **{turn: f'pose.pose.orientation.{turn}' for turn in ('roll', 'pitch', 'yaw')},
    **{turn: f'pose.pose.orientation.{turn}' for turn in ('rx', 'ry', 'rz')},
}
_TWIST = {
    **{f'v{axis}': f'twist.twist.linear.{axis}' for axis in 'xyz'},
    **{f'w{axis}': f'twist.twist.angular.{axis}' for axis in 'xyz'},
}


class OdometryTopic:
    """Pose and twist of an estimate with their covariance.

    Parameters
    ----------
    scenario
        Scenario whose state has a position and a heading.
    frame, child_frame
        Frames of the estimate.

    Raises
    ------
    ValueError
        If the state has no position or no heading.
    """

    def __init__(self, scenario: Scenario, frame: str, child_frame: str) -> None:
        body = body_of(scenario.model.state, scenario.state)
        if not (body.moves and body.turns):
            names = ', '.join(scenario.model.state.names)
            raise ValueError(f'publish_odometry: expected states x, y and a heading, got {names}')
        fields = {**_POSE, **(_TWIST if 'wz' in body.index else {})}
        chosen = {role: index for role, index in body.index.items() if role in fields}
        self._index = np.array(list(chosen.values()))
        self._block = np.ix_(self._index, self._index)
        topic = f'{scenario.state.topic}/odometry'
        self.signal = Signal(topic, 'nav_msgs/Odometry', tuple(fields[role] for role in chosen))
        self._write = WireWriter(SignalCodec(self.signal, frame, child_frame))
        self.message_type = self._write.message_type

    def __call__(self, time: int, belief: Gaussian) -> Any:
        """Return the message for a belief at ``time``, in nanoseconds."""
        x, P = belief
        return self._write(time, x[self._index], P[self._block])
