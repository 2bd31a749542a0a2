# SPDX-License-Identifier: Apache-2.0
"""From frames of sound to messages with a bearing, if a source is detected."""

from __future__ import annotations

from collections import Counter
from math import log
from typing import Any

import numpy as np

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.acoustics.arrival import DirectionFinder
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Array, Signal
from kalman_ros.nodes.middleware.diagnostics import Level, Report

from .options import MicrophoneArrayOptions

_DETECTED, _SILENT, _UNCLEAR = 'bearings', 'frames without a source', 'frames without a direction'


class BearingDetector:
    """Writes the bearing of the source in a frame, and counts frames without one.

    Parameters
    ----------
    signal
        Of the bearing.
    array
        The microphones.
    sample_rate
        Of the sound, in Hz.
    options
        Of the node.
    """

    def __init__(
        self,
        signal: Signal,
        array: MicrophoneArray,
        sample_rate: float,
        options: MicrophoneArrayOptions,
    ) -> None:
        if len(options.band) != 2:
            raise ValueError(f'band: expected 2 numbers, got {len(options.band)}')
        low, high = options.band
        #: Of one frame.
        self.samples = round(options.frame_duration * sample_rate)
        self._find = DirectionFinder(array, sample_rate, self.samples, (low, high))
        self._write = WireWriter(SignalCodec(signal, options.frame))
        self.message_type = self._write.message_type
        self._frames: Counter[str] = Counter()
        self._last = ''
        self._std = np.nan

    def __call__(self, time: int, frame: Array, options: MicrophoneArrayOptions) -> Any:
        """Return the message with the bearing in a frame (M, N), stamped ``time``; or None.

        The thresholds in ``options`` may change from frame to frame.
        """
        bearing, variance, evidence = self._find(frame)
        self._last = _DETECTED
        if not evidence >= log(options.least_odds):
            self._last = _SILENT
        elif variance > options.largest_std**2:
            self._last = _UNCLEAR
        self._frames[self._last] += 1
        if self._last != _DETECTED:
            return None
        self._std = np.sqrt(variance)
        return self._write(time, np.array([bearing]), np.array([[variance]]))

    def report(self) -> Report:
        """Return the counts of frames, by result."""
        values: dict[str, Any] = {
            kind: self._frames[kind] for kind in (_DETECTED, _SILENT, _UNCLEAR)
        }
        values['standard deviation of the last [rad]'] = float(self._std)
        if self._last == _DETECTED:
            return Level.OK, 'source detected', values
        return Level.WARN, f'{self._last or "nothing"}: nothing to publish', values
