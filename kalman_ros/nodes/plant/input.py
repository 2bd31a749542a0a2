# SPDX-License-Identifier: Apache-2.0
"""The input of the plant, held until the next one, and the disturbance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal
from kalman_ros.pipeline.input_messages import InputDecoder
from kalman_ros.scenario.idle import idle_name


class PlantInput:
    """The input as set by messages; the idle input before the first, and after a timeout.

    Parameters
    ----------
    signal
        Topic, type and fields of the input.
    idle
        The input (m,) while no controller acts.
    now
        Returns the nanoseconds of a steady clock.
    """

    def __init__(self, signal: Signal, idle: Array, now: Callable[[], int]) -> None:
        self._read, self._read_disturbance = InputDecoder(signal), WireReader(codec_of(signal))
        self.message_type = self._read.message_type
        self._now = now
        self.idle = idle
        #: Counts of inputs received, and of messages without a finite input.
        self.received = self.refused = 0
        self.reset()

    def reset(self) -> None:
        """Go back to the idle input and no disturbance."""
        self.force: Array = self.idle
        self.disturbance: Array = np.zeros_like(self.idle)
        self._received_at: int | None = None

    @property
    def is_set(self) -> bool:
        """Whether an input is in effect."""
        return self._received_at is not None

    @property
    def idle_name(self) -> str:
        """The idle input as text."""
        return idle_name(self.idle)

    def take(self, data: bytes) -> Sample | None:
        """Count a message and return its input; None if that is not finite."""
        self.received += 1
        return self._finite(self._read, data)

    def hold(self, force: Sample) -> None:
        """Hold this input."""
        self.force, self._received_at = force.values, self._now()

    def disturb(self, data: bytes) -> None:
        """Hold the disturbance in a message."""
        disturbance = self._finite(self._read_disturbance, data)
        if disturbance is not None:
            self.disturbance = disturbance.values

    def drop_old(self, timeout: float) -> float | None:
        """Go to the idle input if the last one is older than ``timeout`` s, and return its age."""
        if self._received_at is None or timeout == 0.0:
            return None
        age = (self._now() - self._received_at) * 1e-9
        if age <= timeout:
            return None
        self.force, self._received_at = self.idle, None
        return age

    def _finite(self, read: Callable[[bytes], Sample], data: bytes) -> Sample | None:
        try:
            sample = read(data)
            if np.isfinite(sample.values).all():
                return sample
        except (LookupError, ValueError):
            pass
        self.refused += 1
        return None
