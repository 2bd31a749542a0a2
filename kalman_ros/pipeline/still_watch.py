# SPDX-License-Identifier: Apache-2.0
"""Watch on the messages of a sensor for whether the body stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Signal
from kalman_ros.core.still import StandStill

#: Nanoseconds between messages beyond which they prove nothing of the time between.
_APART = 1_000_000_000


class StillWatch:
    """Watch that returns for each message the reason why the body is not at rest.

    The body is at rest if all fields are small, for long enough. A field that is missing or not
    finite is not small.

    Parameters
    ----------
    signal
        Signal of the sensor.
    condition
        Fields, sizes and duration.

    Raises
    ------
    ValueError
        If the messages have no stamps, or lack a field.
    """

    def __init__(self, signal: Signal, condition: StandStill) -> None:
        watched = replace(signal, fields=condition.fields, covariance='')
        self._read = WireReader(codec_of(watched))
        if not hasattr(self._read.message_type, 'header'):
            why = f'expected messages with a stamp, {signal.type} has none'
            raise ValueError(f"signal '{signal.topic}': still.below: {why}")
        self._below = np.array(condition.below)
        self._duration = round(condition.duration * 1e9)
        #: Stamps in nanoseconds between which all messages were small.
        self._since: int | None = None
        self._until = 0

    def __call__(self, data: bytes, time: int | None) -> str:
        """Return why the body is not at rest, by a message that can be decoded; '' if it is."""
        if not time:
            return 'a stamp of zero does not say for how long the body was at rest'
        if not self._is_small(data):
            # a late message of motion ends what was small before it, not after
            if self._since is not None and time >= self._since:
                self._since = None
            return 'the body moves'
        apart = self._since is not None and not -_APART <= time - self._until <= _APART
        if self._since is None or apart:
            self._since = self._until = time
        self._until = max(self._until, time)
        if time - self._since >= self._duration:
            return ''
        return 'messages more than 1 s apart' if apart else 'not at rest for still.duration yet'

    def _is_small(self, data: bytes) -> bool:
        try:
            _, values, _ = self._read(data)
        except (LookupError, ValueError):
            return False
        return bool((np.abs(values) < self._below).all())
