# SPDX-License-Identifier: Apache-2.0
"""Poses in a recording: the output of another estimator, or a truth."""

from __future__ import annotations

import struct

import numpy as np

from kalman_ros.analysis.pose_paths import PosePath
from kalman_ros.codecs.messages import UndecodableError, leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal, is_finite

from .columns import Rows
from .reading import Bag

#: Where the pose is, by the type of its message.
_POSES = {
    'nav_msgs/msg/Odometry': 'pose.pose',
    'geometry_msgs/msg/PoseWithCovarianceStamped': 'pose.pose',
    'geometry_msgs/msg/PoseStamped': 'pose',
}
_FIELDS = (
    *(f'position.{axis}' for axis in 'xyz'),
    *(f'orientation.{number}' for number in ('rx', 'ry', 'rz')),
)


def has_poses(bag: Bag, topic: str) -> bool:
    """Return whether a topic is recorded with a type that is a pose."""
    return len(bag.topics.get(topic, ())) == 1 and not bag.topics[topic] - _POSES.keys()


class PoseReader:
    """Reader of the poses on a topic.

    Parameters
    ----------
    bag
        Recording.
    topic
        Full name of the topic.
    purpose
        What an error calls it.

    Raises
    ------
    ValueError
        If the recording has no such topic, or its messages are no poses.
    """

    def __init__(self, bag: Bag, topic: str, purpose: str) -> None:
        if topic not in bag.topics:
            bag.check(topic, '', purpose)
        if not has_poses(bag, topic):
            expected = ', '.join(name.replace('/msg/', '/') for name in _POSES)
            got = ' and '.join(sorted(bag.topics[topic])).replace('/msg/', '/')
            raise ValueError(f'{purpose}: expected {expected} on {topic}, recorded is {got}')
        self.topic = topic
        (kind,) = bag.topics[topic]
        fields = tuple(f'{_POSES[kind]}.{field}' for field in _FIELDS)
        self._read = WireReader(SignalCodec(Signal(topic, kind.replace('/msg/', '/'), fields)))
        self._rows = Rows(pose=(6,), covariance=(6, 6))
        self._stamps: list[int] = []
        self._frame, self._skipped = '', 0

    def __call__(self, data: bytes) -> None:
        """Add the pose in a message; count it if it has no stamp, is not finite or elsewhere."""
        try:
            time, pose, C = self._read(data)
            frame = leading_frame(data)
        except (UndecodableError, LookupError, ValueError, struct.error):
            time = None
        # zero stands for no stamp
        if not time or not is_finite(pose) or frame != (self._frame or frame):
            self._skipped += 1
            return
        self._frame = frame
        self._stamps.append(time)
        self._rows.append(pose, C if C is not None and is_finite(C) else None)

    def result(self, start: int) -> PosePath:
        """Return the poses in the order of their stamps, each stamp once."""
        stamps, which = np.unique(np.array(self._stamps, dtype=np.int64), return_index=True)
        columns = self._rows.columns()
        pose, C = columns['pose'][which], columns['covariance'][which][:, :3, :3]
        # many publish zeros where they do not know
        known = len(C) and np.isfinite(C).all() and np.all(C[:, (0, 1), (0, 1)] > 0.0)
        time = np.asarray((stamps - start) * 1e-9)
        covariance = C if known else None
        return PosePath(
            time, pose[:, :3], pose[:, 3:], covariance, self._frame, skipped=self._skipped
        )
