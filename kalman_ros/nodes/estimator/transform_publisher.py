# SPDX-License-Identifier: Apache-2.0
"""Publishes the pose of the estimate on ``/tf``, while that is what tf2 and its users can take."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Mapping
from time import monotonic
from typing import Any

from kalman_ros.codecs.messages import STAMP, frame_and_end
from kalman_ros.codecs.transform_list import transforms_in
from kalman_ros.core import Gaussian
from kalman_ros.nodes.middleware.connections import other_publishers
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import STATIC, TRANSFORMS
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.pipeline.frames import STATIC as TF_STATIC
from kalman_ros.pipeline.frames import TF
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.pipeline.transforms import TransformTree, TransformWriter
from kalman_ros.scenario import Scenario

#: Of the messages of one length, as one node sends them, at most one in this time is read, in
#: nanoseconds: a parent is named again and again.
_SAMPLED = 20_000_000
_MOST_LENGTHS = 1000
#: The number of sent transforms that may be under way.
_MOST_SENT = 1000
#: Number of transforms of someone else, and seconds since the last one, that are a publisher.
_FOREIGN, _RECENTLY = 3, 5.0
#: The number of transforms in a message of one.
_ONE = (b'\1\0\0\0', b'\0\0\0\1')


class TransformPublisher:
    """Publishes a transform for each estimate.

    It is silent once no reading was fused for ``tf_timeout``, and while tf2 would refuse the
    transform beside those of others.

    Parameters
    ----------
    node
        The estimator's node.
    scenario, options
        Of the estimator.

    Raises
    ------
    ValueError
        If there can be no transform.
    """

    def __init__(self, node: Host, scenario: Scenario, options: EstimatorOptions) -> None:
        self._node, self._options = node, options
        self._write = TransformWriter(scenario, options)
        self._tree = TransformTree()
        self._warn = Throttle(node.get_logger().warning, 10.0)
        self._publisher = node.create_publisher(self._write.message_type, TF, TRANSFORMS)
        #: When the next message of a length is read, in nanoseconds.
        self._due: dict[int, int] = {}
        #: Stamps of the last transforms, as bytes, that have not come back yet.
        self._sent: deque[bytes] = deque(maxlen=_MOST_SENT)
        #: When transforms of these frames came that someone else published.
        self._foreign: deque[float] = deque(maxlen=_FOREIGN)
        self.count = 0
        #: Why the last one was not published; '' if it was.
        self.refusal = ''

    def subscribe(self) -> None:
        """Subscribe to the transforms of others."""
        node, kind = self._node, self._write.message_type
        node.create_subscription(kind, TF, self._on_tf, TRANSFORMS, raw=True)
        node.create_subscription(kind, TF_STATIC, self._on_static, STATIC, raw=True)

    def __call__(self, time: int, belief: Gaussian, fused_at: int | None) -> None:
        """Publish the transform of a ``belief`` at ``time``; the last reading was ``fused_at``."""
        self.refusal = self._refusal(time, fused_at)
        message = None if self.refusal else self._write(time, belief.mean)
        if message is None:
            frames = f"'{self._options.odom_frame}' to '{self._options.child_frame}'"
            self.refusal = self.refusal or f'no transform {frames} near the time of the estimate'
            self._warn(f'no transform: {self.refusal}')
            return
        stamp = message.transforms[0].header.stamp
        self._sent.append(STAMP.pack(stamp.sec, stamp.nanosec))
        self._publisher.publish(message)
        self.count += 1

    def report(self, level: Level, message: str, values: Mapping[str, Any]) -> Report:
        """Return the report of the estimator, with what became of the transforms."""
        values = {**values, 'transforms published': self.count}
        wrong = self._rivalry()
        if self.refusal:
            values['no transform'] = self.refusal
            wrong = f'no transform: {self.refusal}'
        if not wrong:
            return level, message, values
        return Level.WARN, wrong if level is Level.OK else f'{message}; {wrong}', values

    def _rivalry(self) -> str:
        """Return that someone else publishes the same transform; '' if not."""
        times = self._foreign
        if len(times) < _FOREIGN or monotonic() - times[-1] > _RECENTLY:
            return ''
        transform = f"the transform '{self._options.frame}' to '{self._write.child}'"
        names = other_publishers(self._node, TF)
        by = f'one of {", ".join(names)}' if len(names) > 1 else (*names, 'another node')[0]
        return f'{transform} is published by {by}, too'

    def _recognise(self, stamp: bytes) -> None:
        """Note whether a transform of these frames is one of those that were sent."""
        try:
            self._sent.remove(stamp)
        except ValueError:
            self._note_foreign()

    def _note_foreign(self) -> None:
        self._foreign.append(monotonic())
        rivalry = self._rivalry()
        if rivalry:
            self._warn(rivalry)

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _refusal(self, time: int, fused_at: int | None) -> str:
        now = self._now()
        newest = time if self._options.lockstep else max(time, now)
        timeout = self._options.tf_timeout
        if fused_at is None:
            return 'no reading was fused yet'
        age = (newest - fused_at) * 1e-9
        if age > timeout:
            return f'the last reading is {age:.1f} s old, tf_timeout is {timeout:g} s'
        return self._tree.refusal(self._options.frame, self._write.child, now)

    def _on_tf(self, data: bytes) -> None:
        if self._is_own(data):
            self._recognise(data[8 : 8 + STAMP.size])
            return
        now = self._now()
        due = self._due.get(len(data), now)
        if self._options.odom_frame or not 0 < due - now <= _SAMPLED:
            if len(self._due) > _MOST_LENGTHS:
                self._due.clear()
            self._due[len(data)] = now + _SAMPLED
            self._take(data, static=False)

    def _on_static(self, data: bytes) -> None:
        self._take(data, static=True)

    def _take(self, data: bytes, *, static: bool) -> None:
        transforms = self._node.intake.read(TF_STATIC if static else TF, transforms_in, data) or []
        published = self._options.frame, self._write.child
        for transform in transforms:
            pair = transform.parent, transform.child
            if static or pair != published:
                self._tree.add(*pair, self._now(), static=static)
            else:  # beside others in a message, which none from here has
                self._note_foreign()
        if self._options.odom_frame:
            self._write.history.add(transforms, static=static)

    def _is_own(self, data: bytes) -> bool:
        """Return whether a message has nothing but the transform that is published here."""
        if data[4:8] not in _ONE:
            return False
        one = data[:4] + data[8:]  # without the number of transforms it begins with a header
        try:
            frames = tuple(frame_and_end(one, of_child=of_child)[0] for of_child in (False, True))
        except struct.error:
            return False
        return frames == (self._options.frame, self._write.child)
