# SPDX-License-Identifier: Apache-2.0
"""The pose of an estimate as a transform of tf2, with the checks that tf2 makes."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.codecs.messages import message_type, write_stamp
from kalman_ros.core import Array, is_finite
from kalman_ros.core import rotations as so3
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

from .estimator_options import EstimatorOptions
from .frames import Placement
from .pose_history import FrameHistory

TYPE = 'tf2_msgs/TFMessage'


def check_frame(argument: str, name: str) -> None:
    """Raise ValueError for a name that tf2 refuses."""
    if not name or name.startswith('/'):
        expected = 'expected a frame without a leading slash for publish_tf'
        raise ValueError(f"{argument}: {expected}, got '{name}'")


def check_frames(options: EstimatorOptions) -> None:
    """Raise ValueError where tf2 would refuse the transform of an estimator."""
    for argument in ('frame', 'child_frame'):
        check_frame(argument, getattr(options, argument))
    if options.frame == options.child_frame:
        raise ValueError(f"child_frame: expected another than frame, got '{options.frame}'")
    if options.odom_frame:
        check_frame('odom_frame', options.odom_frame)
        if options.odom_frame in (options.frame, options.child_frame):
            expected = f'expected another than frame and child_frame, got {options.odom_frame!r}'
            raise ValueError(f'odom_frame: {expected}')


def why_none() -> str:
    """Return why there are no transforms, in words; '' where ``tf2_msgs`` is installed."""
    try:
        message_type(TYPE)
    except ValueError as error:
        return f'{str(error).removeprefix("type: ")} (in ROS: ros-jazzy-tf2-msgs)'
    return ''


class TransformWriter:
    """Writer of the pose of an estimate as a ``tf2_msgs/TFMessage``.

    Without ``odom_frame`` it writes the transform from ``frame`` to ``child_frame``; with it, the
    transform from ``frame`` to that frame, in which others place ``child_frame`` (REP-105).

    Parameters
    ----------
    scenario
        Scenario whose state has a position and a heading.
    options
        Options of the estimator.

    Raises
    ------
    ValueError
        If tf2_msgs is not installed, the state has no pose, or tf2 would refuse the transform.
    """

    def __init__(self, scenario: Scenario, options: EstimatorOptions) -> None:
        self.message_type = message_type(TYPE)
        check_frames(options)
        self._body = body_of(scenario.model.state, scenario.state)
        if not (self._body.moves and self._body.turns):
            names = ', '.join(scenario.model.state.names)
            raise ValueError(f'publish_tf: expected states x, y and a heading, got {names}')
        self._options = options
        self.child = options.odom_frame or options.child_frame
        #: The body in the frame between, by the transforms of others.
        self.history = FrameHistory(self.child, options.child_frame)
        self.message = self.message_type()
        transform = message_type('geometry_msgs/TransformStamped')()
        transform.header.frame_id, transform.child_frame_id = options.frame, self.child
        self.message.transforms = [transform]

    def __call__(self, time: int, x: Array) -> Any:
        """Return the message for a state (n,) at ``time``, in nanoseconds.

        It is None without the transform of another node near that time, or where it would not be
        finite.
        """
        body, options = self._body, self._options
        pose = Placement(np.array([body.value(x, axis) for axis in 'xyz']), body.attitude(x))
        if options.odom_frame:
            # where the stamps of others are shifted as those from here
            shifted = time + round(options.tf_time_offset * 1e9)
            other = self.history.at(shifted, options.tf_timeout)
            if other is None:
                return None
            # both are of the same body: that of one frame in the other one
            pose = pose.then(other.inverse())
        numbers = np.concatenate((pose.translation, so3.to_quaternion(pose.rotation)))
        if not is_finite(numbers):
            return None
        transform = self.message.transforms[0]
        write_stamp(transform.header.stamp, time + round(options.tf_time_offset * 1e9))
        to, q = transform.transform.translation, transform.transform.rotation
        to.x, to.y, to.z, q.x, q.y, q.z, q.w = numbers.tolist()
        return self.message


#: Nanoseconds for which a transform of another node on /tf counts.
_REMEMBERED = 10_000_000_000
#: Largest number of frames that are kept.
_MOST_FRAMES = 10_000


class TransformTree:
    """The parents of frames, as other nodes publish them."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, float]] = {}

    def add(self, parent: str, child: str, now: int, *, static: bool) -> None:
        """Add a transform that was received at ``now``, in nanoseconds."""
        if len(self._parents) < _MOST_FRAMES or child in self._parents:
            until = np.inf if static else now + _REMEMBERED
            self._parents[child] = parent, until

    def refusal(self, parent: str, child: str, now: int) -> str:
        """Return why tf2 would refuse a transform beside those of others; '' if it would not."""
        other = self._parent(child, now)
        if other and other != parent:
            return f"'{child}' has the parent '{other}' already and cannot have '{parent}', too"
        above, seen = self._parent(parent, now), {parent}
        while above and above not in seen:
            if above == child:
                return f"'{child}' is above '{parent}' already: a loop"
            seen.add(above)
            above = self._parent(above, now)
        return ''

    def _parent(self, child: str, now: int) -> str:
        parent, until = self._parents.get(child, ('', 0.0))
        return parent if now < until else ''
