# SPDX-License-Identifier: Apache-2.0
"""The codec of a signal by its type and fields."""

from __future__ import annotations

from typing import Union

from kalman_ros.core import Signal
from kalman_ros.core.geodesy import Origin

from .fixes import FixCodec, is_local
from .signal_codec import SignalCodec
from .turned_codec import TurnedCodec

Codec = Union[SignalCodec, FixCodec, TurnedCodec]


def codec_of(
    signal: Signal, frame: str = '', child_frame: str = '', origin: Origin | None = None
) -> Codec:
    """Return the codec of a signal.

    Parameters
    ----------
    signal
        Topic, type and fields.
    frame, child_frame
        Frames for ``header.frame_id`` and ``child_frame_id``, if these fields exist.
    origin
        Datum that several receivers share; None for the datum of the signal.

    Raises
    ------
    ValueError
        If the type is not installed or lacks a field; the error names the topic.
    """
    frame = signal.mounting.frame or frame
    turned = signal.mounting.turned
    if is_local(signal):
        if turned:
            why = 'mount.rotation, convention: a fix has no axes'
            raise ValueError(f"signal '{signal.topic}': {why}")
        return FixCodec(signal, frame, origin)
    if turned:
        return TurnedCodec(signal, frame, child_frame)
    return SignalCodec(signal, frame, child_frame)
