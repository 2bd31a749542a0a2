# SPDX-License-Identifier: Apache-2.0
"""What drives a plant: the last input, held until the next, and a disturbance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal


class PlantInput:
    """The input of a plant as messages set it; one that is old gives way to the idle input.

    Parameters
    ----------
    signal
        Where the input is found.
    idle
        The input (m,) while nobody sets one.
    now
        Returns nanoseconds on a clock that never rests.
    """

    def __init__(self, signal: Signal, idle: Array, now: Callable[[], int]) -> None:
        self._read = WireReader(SignalCodec(signal))
        self.message_type = self._read.message_type
        self._now = now
        self.idle = idle
        #: How many came, and how many messages had no finite input in them.
        self.heard = self.refused = 0
        self.start_anew()

    def start_anew(self) -> None:
        """Have no input until one comes."""
        self.force: Array = self.idle
        self.disturbance: Array = np.zeros_like(self.idle)
        self._came: int | None = None

    @property
    def is_set(self) -> bool:
        """Whether an input has come, and is not too old."""
        return self._came is not None

    @property
    def idle_name(self) -> str:
        """What the idle input is, in words."""
        return "the equilibrium's" if self.idle.any() else 'zero'

    def take(self, data: bytes) -> Sample | None:
        """Count a message and return the finite input in it; None if there is none."""
        self.heard += 1
        return self._finite(data)

    def hold(self, force: Sample) -> None:
        """Have this input from now on."""
        self.force, self._came = force.values, self._now()

    def disturb(self, data: bytes) -> None:
        """Have the disturbance in a message from now on."""
        disturbance = self._finite(data)
        if disturbance is not None:
            self.disturbance = disturbance.values

    def drop_old(self, timeout: float) -> float | None:
        """Go to the idle input if the last one is older than so many seconds; return its age."""
        if self._came is None or timeout == 0.0:
            return None
        age = (self._now() - self._came) * 1e-9
        if age <= timeout:
            return None
        self.force, self._came = self.idle, None
        return age

    def _finite(self, data: bytes) -> Sample | None:
        try:
            sample = self._read(data)
            if np.isfinite(sample.values).all():
                return sample
        except (LookupError, ValueError):
            pass
        self.refused += 1
        return None
