# SPDX-License-Identifier: Apache-2.0
"""The sound at an array of microphones: each has its own delay and noise."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.core import Array

from .noise import stream

#: Least distance from a source to a microphone, in m.
_NEAREST = 0.01


class Sound(NamedTuple):
    """A source and its surroundings.

    Parameters
    ----------
    level
        Root mean square of the sound pressure at 1 m from the source, in Pa.
    band
        Lowest and highest frequency of the source, in Hz; white between them.
    noise
        Root mean square of each microphone's own noise, in Pa; white.
    """

    level: float
    band: tuple[float, float]
    noise: float


class SimulatedSound:
    """Frames of sound from an array in the open.

    Waves are spherical: at the distance r from the source the pressure is its level over r,
    delayed by r / c. The source is at rest during a frame, at its current position. The common
    travel time is neglected, so true bearings lag by the transverse speed over c.

    Parameters
    ----------
    array
        The microphones.
    sample_rate
        Samples per second.
    samples
        Number of samples N of one frame.
    sound
        Source and its surroundings.
    seed
        Seed of the sound and of the noise.

    Raises
    ------
    ValueError
        If there is no frequency in the band of the sound.
    """

    def __init__(
        self, array: MicrophoneArray, sample_rate: float, samples: int, sound: Sound, seed: int
    ) -> None:
        self._array, self._samples, self._sound = array, samples, sound
        # the frame is cut from a longer piece, so that no delay reaches beyond its ends
        longest = array.radius / array.speed_of_sound
        self._margin = ceil(longest * sample_rate) + 1
        whole = samples + 2 * self._margin
        self._frequencies = np.fft.rfftfreq(whole, 1.0 / sample_rate)
        low, high = sound.band
        self._inside = (low <= self._frequencies) & (self._frequencies <= high)
        share = np.count_nonzero(self._inside) / len(self._inside)
        if not share:
            raise ValueError(
                f'band: expected frequencies up to {sample_rate / 2.0:g} Hz, '
                f'got {low:g} to {high:g} Hz'
            )
        # white noise loses the power outside the band
        self._scale = sound.level / np.sqrt(share)
        self._source, self._noise = stream(seed, 'sound source'), stream(seed, 'microphones')

    def __call__(self, place: Array) -> Array:
        """Return a frame (M, N) while the source is at ``place`` (2,), in m from the array."""
        offsets = place - self._array.positions
        r = np.maximum(np.hypot(*offsets.T), _NEAREST)[:, np.newaxis]
        # the common delay is omitted, since a receiver does not know it
        later = (r - np.hypot(*place)) / self._array.speed_of_sound
        whole = self._samples + 2 * self._margin
        spectrum = np.fft.rfft(self._scale * self._source.standard_normal(whole)) * self._inside
        waves = spectrum * np.exp(-2j * np.pi * self._frequencies * later) / r
        frame = np.fft.irfft(waves, whole)[:, self._margin : self._margin + self._samples]
        return np.asarray(frame + self._sound.noise * self._noise.standard_normal(frame.shape))
