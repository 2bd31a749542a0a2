# SPDX-License-Identifier: Apache-2.0
"""Check of the frames of a sensor's messages: an undeclared frame is another sensor's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from kalman_ros.codecs.messages import FRAME_START, frame_and_end
from kalman_ros.core import Signal
from kalman_ros.core.quantity import ATTITUDE, PLACE, quantity

_HEADER = 'std_msgs/Header'
#: Bytes of an empty frame, and a length that no frame has.
_EMPTY, _NONE_YET = b'\x01\0\0\0\0', b'\xff\xff\xff\xff'
_CHILD, _TWIST = 'child_frame_id', 'twist.'


class FrameGuard:
    """Comparison of the frame of each message with the frame of its sensor.

    The frame is the ``header.frame_id``, or the ``child_frame_id`` if only the twist of an
    odometry is read; a message in which it is empty can be of any frame. If no frame is declared,
    that of the first message counts, and one warning names it, unless it is a frame of the
    estimate or the mounting is configured.

    Parameters
    ----------
    signal
        Signal of the sensor.
    message_type
        Type of the messages; a type that does not begin with a header has no frame.
    frames
        Frames of the estimate: of positions, and of the body.
    warn
        Function that is called with one line.
    """

    def __init__(
        self,
        signal: Signal,
        message_type: Any,
        frames: Sequence[str],
        warn: Callable[[str], object],
    ) -> None:
        fields = message_type.get_fields_and_field_types()
        stamped = next(iter(fields.values()), '') == _HEADER
        twist = all(field.startswith(_TWIST) for field in signal.fields)
        self._of_child = twist and _CHILD in fields
        empty = _NONE_YET if self._of_child else _EMPTY
        #: A message with these bytes after its stamp has the right frame.
        self.accepted = empty if stamped else b''
        kinds = {item.kind for item in map(quantity, signal.fields) if item is not None}
        self._of_world = bool(kinds) and kinds <= {PLACE, ATTITUDE} and len(frames) > 0
        self._frames, self._warn = frames, warn
        self._placed = signal.mounting.placed
        self._frame: str | None = signal.mounting.frame or None

    @property
    def frame(self) -> str:
        """Frame of the messages; '' before the first message that names one."""
        return self._frame or ''

    def __call__(self, data: bytes) -> str:
        """Return the fault in the frame of a message that can be decoded; '' without a fault."""
        if data.startswith(self.accepted, FRAME_START):
            return ''
        frame, end = frame_and_end(data, of_child=self._of_child)
        if not frame:
            self.accepted = data[FRAME_START:end]
            return ''
        if self._frame is None:
            self._frame = frame
            self._announce(frame)
        if frame != self._frame:
            return f"expected frame '{self._frame}', got '{frame}'"
        self.accepted = data[FRAME_START:end]
        return ''

    def _announce(self, frame: str) -> None:
        """Warn about a frame that was not declared."""
        if frame in self._frames or self._placed or not self._frames:
            return
        meant = self._frames[0 if self._of_world else -1]
        self._warn(f"frame '{frame}' is taken for {meant}; declare frame and mount to be sure")
