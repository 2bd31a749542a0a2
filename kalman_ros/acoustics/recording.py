# SPDX-License-Identifier: Apache-2.0
"""Recorded sound: a WAV file with one channel per microphone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kalman_ros.core import Array


@dataclass(frozen=True)
class Recording:
    """Channels of sound.

    Parameters
    ----------
    sample_rate
        Samples per second.
    channels
        Sound (M, N), in any unit.
    """

    sample_rate: float
    channels: Array

    def frame(self, start: float, samples: int) -> Array | None:
        """Return ``samples`` samples (M, samples) from ``start`` seconds on; None past the end."""
        first = round(start * self.sample_rate)
        frame = self.channels[:, first : first + samples]
        return frame if frame.shape[1] == samples else None


def read(path: Path, channels: int) -> Recording:
    """Return the recording in a WAV file with ``channels`` channels.

    Raises
    ------
    ValueError
        If the file is missing, unreadable, or has another number of channels.
    """
    from scipy.io import wavfile  # slow to import, and rarely needed

    try:
        sample_rate, data = wavfile.read(path)
    except (OSError, ValueError) as error:
        raise ValueError(f"recording: cannot read '{path}': {error}") from None
    sound = np.atleast_2d(data.T)
    if len(sound) != channels:
        raise ValueError(
            f'recording: expected {channels} channels, one a microphone, got {len(sound)}'
        )
    return Recording(float(sample_rate), sound.astype(float))
