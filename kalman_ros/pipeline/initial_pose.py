# SPDX-License-Identifier: Apache-2.0
"""Reset of the state to a pose on ``initialpose``, as published by RViz, or ``set_pose``."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Gaussian, Signal, is_finite, semidefinite
from kalman_ros.core import rotations as so3
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

#: The topics of poses: of RViz, and of users of robot_localization.
POSES = 'initialpose', 'set_pose'
#: The one of this estimator alone.
OWN_POSE = '~/set_pose'
_TYPE = 'geometry_msgs/PoseWithCovarianceStamped'
_PLACE, _TURNS, _VECTOR = ('x', 'y', 'z'), ('roll', 'pitch', 'yaw'), ('rx', 'ry', 'rz')
_FIELDS = (
    *(f'pose.pose.position.{axis}' for axis in _PLACE),
    *(f'pose.pose.orientation.{turn}' for turn in _TURNS),
)


class PoseReader:
    """Reader of a pose, which replaces the coordinates of a state that it contains.

    Those are the position and the attitude of the body, by the fields of the state's message or by
    the names of states with a position in the plane. What the message gives no variance, such as
    the height in a pose of RViz in the plane, stays as it is believed. Without any variance the
    pose counts, with the initial uncertainty.

    Parameters
    ----------
    scenario
        Scenario of the estimator.
    frame
        Frame of its estimates; a pose in another one is refused, one without a frame is not.
    """

    def __init__(self, scenario: Scenario, frame: str = '') -> None:
        body = body_of(scenario.model.state, scenario.state)
        fields, roles = scenario.state.fields, body.index
        named = roles if body.moves else {}
        #: By role, the coordinate of the state.
        self._index = {
            role: index
            for role, index in roles.items()
            if role in named or fields[index].startswith('pose.pose.')
        }
        self._rotation = [self._index[role] for role in _VECTOR if role in self._index]
        #: By number of a pose, the coordinate of its error.
        self._errors = {
            k: self._index[role]
            for roles in ((*_PLACE, *_TURNS), ('', '', '', *_VECTOR))
            for k, role in enumerate(roles)
            if role in self._index
        }
        self._frame = frame
        codec = SignalCodec(Signal('initialpose', _TYPE, _FIELDS))
        self._read = WireReader(codec)
        self.message_type = codec.message_type

    def __call__(self, data: bytes, initial: Gaussian) -> Gaussian:
        """Return the ``initial`` belief with the pose and its covariance.

        Raises
        ------
        ValueError
            If the state has no pose, or the pose is not finite, is in another frame, or its
            covariance is not definite.
        """
        _, values, covariance = self._read(data)
        if not self._errors:
            raise ValueError('the state of this model has no pose')
        given = leading_frame(data)
        if self._frame and given and given != self._frame:
            raise ValueError(f"expected frame '{self._frame}', got '{given}'")
        if not is_finite(values[3:]) and max(self._errors) > 2:
            raise ValueError('orientation: expected a quaternion that is a rotation, not of zeros')
        if not is_finite(values[:3]):
            raise ValueError('expected finite numbers')
        assert covariance is not None
        return self._put(values, covariance, initial)

    def _put(self, pose: Array, R: Array, initial: Gaussian) -> Gaussian:
        """Return the belief with a position and angles (6,), whose errors have covariance R."""
        mean, P = initial.mean.copy(), initial.covariance.copy()
        known = {k: place for k, place in self._errors.items() if R[k].any()} or self._errors
        chosen, indices = [*known], [*known.values()]
        if R.any():
            block = R[np.ix_(chosen, chosen)]
            block = semidefinite('covariance', block, len(chosen), definite=True)
            P[indices, :] = 0.0
            P[:, indices] = 0.0
            P[np.ix_(indices, indices)] = block
        if len(self._rotation) == 3:
            before = so3.to_euler(mean[self._rotation])
            turned = np.where([k in chosen for k in (3, 4, 5)], pose[3:], before)
            mean[self._rotation] = so3.from_euler(turned)
        for k in chosen:
            role = (*_PLACE, *_TURNS)[k]
            if role in self._index:
                mean[self._index[role]] = pose[k]
        return Gaussian(mean, P)
