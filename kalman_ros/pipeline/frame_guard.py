# SPDX-License-Identifier: Apache-2.0
"""The frames of a sensor's messages: another than the declared one is another sensor's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from kalman_ros.codecs.messages import FRAME_START, frame_and_end
from kalman_ros.core import Signal
from kalman_ros.core.quantity import ATTITUDE, PLACE, quantity

_HEADER = 'std_msgs/Header'
#: A message without a frame, and the length of none.
_EMPTY, _NONE_YET = b'\x01\0\0\0\0', b'\xff\xff\xff\xff'
_CHILD, _TWIST = 'child_frame_id', 'twist.'


class FrameGuard:
    """Compares the frame of each message with that of its sensor.

    It is the ``header.frame_id``, or the ``child_frame_id`` where only the twist of an odometry is
    read; a message without one can be of any frame. Where none is declared, it is that of the
    first message; unless that is a frame of the estimate, or the mounting is given, one warning
    names it.

    Parameters
    ----------
    signal
        Of the sensor.
    message_type
        A type that does not begin with a header has no frame.
    own
        The frames of the estimate: of positions, and of the body.
    warn
        Called with one line.
    """

    def __init__(
        self,
        signal: Signal,
        message_type: Any,
        own: Sequence[str],
        warn: Callable[[str], object],
    ) -> None:
        fields = message_type.get_fields_and_field_types()
        stamped = next(iter(fields.values()), '') == _HEADER
        twist = all(field.startswith(_TWIST) for field in signal.fields)
        self._of_child = twist and _CHILD in fields
        empty = _NONE_YET if self._of_child else _EMPTY
        #: A message with these bytes after its stamp is of the right frame.
        self.accepted = empty if stamped else b''
        kinds = {found.kind for found in map(quantity, signal.fields) if found is not None}
        self._of_world = bool(kinds) and kinds <= {PLACE, ATTITUDE} and len(own) > 0
        self._own, self._warn = own, warn
        self._placed = signal.mounting.placed
        self._frame: str | None = signal.mounting.frame or None

    @property
    def frame(self) -> str:
        """The frame of the messages; '' before the first that names one."""
        return self._frame or ''

    def __call__(self, data: bytes) -> str:
        """Return what is wrong with the frame of a message that can be decoded; '' if nothing."""
        if data.startswith(self.accepted, FRAME_START):
            return ''
        frame, end = frame_and_end(data, of_child=self._of_child)
        if not frame:
            return ''
        if self._frame is None:
            self._frame = frame
            self._announce(frame)
        if frame != self._frame:
            return f"expected frame '{self._frame}', got '{frame}'"
        self.accepted = data[FRAME_START:end]
        return ''

    def _announce(self, frame: str) -> None:
        """Warn of a frame that was not declared."""
        if frame in self._own or self._placed or not self._own:
            return
        meant = self._own[0 if self._of_world else -1]
        self._warn(f"frame '{frame}' is taken for {meant}; declare frame and mount to be sure")
