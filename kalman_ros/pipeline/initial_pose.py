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

from .frames import Frames, Placement

#: The topic of RViz, which all nodes that can be placed share.
SHARED = 'initialpose'
#: The topics of poses: of RViz, and of users of robot_localization.
POSES = SHARED, 'set_pose'
#: The one of this estimator alone.
OWN_POSE = '~/set_pose'
_TYPE = 'geometry_msgs/PoseWithCovarianceStamped'
_PLACE, _TURNS, _VECTOR = ('x', 'y', 'z'), ('roll', 'pitch', 'yaw'), ('rx', 'ry', 'rz')
#: From a position farther away, in m, no reading brings the estimate back.
_FARTHEST = 1e7
#: A smaller share of the largest variance is rounding.
_ROUNDING = 1e-12
_FIELDS = (
    *(f'pose.pose.position.{axis}' for axis in _PLACE),
    *(f'pose.pose.orientation.{turn}' for turn in _TURNS),
)


class ForeignFrameError(ValueError):
    """A pose is in a frame whose place is not known.

    Parameters
    ----------
    expected, frame
        Frame of the estimates, and that of the pose.
    """

    def __init__(self, expected: str, frame: str) -> None:
        super().__init__(f"expected frame '{expected}', or one with a transform, got '{frame}'")
        self.frame = frame


class OthersPoseError(ValueError):
    """A pose is for the node that places the frame of these estimates in that of the pose.

    Parameters
    ----------
    expected, frame
        Frame of the estimates, and that of the pose.
    """

    def __init__(self, expected: str, frame: str) -> None:
        super().__init__(f"left to the node that places '{expected}' in '{frame}' on /tf")


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
        Frame of its estimates; a pose without a frame is in it.
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

    def __call__(
        self, data: bytes, initial: Gaussian, frames: Frames | None = None, *, shared: bool = False
    ) -> Gaussian:
        """Return the ``initial`` belief with the pose and its covariance.

        A pose in another frame is transformed by what is known of ``frames``. One on a ``shared``
        topic, in a frame in which another node moves this one, is for that node: the odometry of
        a robot goes on smoothly while AMCL is placed (REP-105).

        Raises
        ------
        ForeignFrameError
            If the pose is in a frame whose place is not known.
        OthersPoseError
            If the pose is for another node.
        ValueError
            If the state has no pose, or the pose is not finite, or its covariance is not definite.
        """
        with np.errstate(all='ignore'):  # of numbers that are refused
            return self._belief(data, initial, frames, shared)

    def _belief(
        self, data: bytes, initial: Gaussian, frames: Frames | None, shared: bool
    ) -> Gaussian:
        _, values, covariance = self._read(data)
        if not self._errors:
            raise ValueError('the state of this model has no pose')
        assert covariance is not None
        given = leading_frame(data)
        if self._frame and given and given != self._frame:
            place = frames.placement(given, self._frame) if frames else None
            if place is None:
                raise ForeignFrameError(self._frame, given)
            if shared and frames and frames.moves_in(self._frame, given):
                raise OthersPoseError(self._frame, given)
            values, covariance = moved(values, covariance, place)
        if not is_finite(values[3:]) and max(self._errors) > 2:
            raise ValueError('orientation: expected a quaternion that is a rotation, not of zeros')
        if not is_finite(values[:3]):
            raise ValueError('expected finite numbers')
        if np.abs(values[:3]).max() > _FARTHEST:
            raise ValueError(
                f'expected a position within {_FARTHEST:g} m, got {values[:3].tolist()}'
            )
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


def moved(pose: Array, R: Array, place: Placement) -> tuple[Array, Array]:
    """Return a pose, position and angles (6,), and its covariance (6, 6), in an outer frame.

    ``place`` is that of its frame there. Errors are about the axes of a frame, so they turn with
    it; angles that are not finite stay so.
    """
    turned = Placement(pose[:3], so3.from_euler(pose[3:]))
    position, rotation = place.then(turned)
    G = np.kron(np.eye(2), so3.exp(place.rotation))
    covariance = G @ R @ G.T
    covariance[np.abs(covariance) < _ROUNDING * R.max()] = 0.0  # what was unknown is not known now
    return np.concatenate((position, so3.to_euler(rotation))), covariance
