# SPDX-License-Identifier: Apache-2.0
"""What microphones hear of a source that makes a noise: each a little later, and its own hiss."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.core import Array

from .noise import stream

#: Nearer than this, in m, no source is to a microphone.
_NEAREST = 0.01


class Sound(NamedTuple):
    """A source and its surroundings.

    Parameters
    ----------
    level
        Root mean square of the sound pressure at 1 m from the source, in Pa.
    band
        The lowest and highest frequency of the source, in Hz; white between them.
    noise
        Root mean square of each microphone's own noise, in Pa; white.
    """

    level: float
    band: tuple[float, float]
    noise: float


class SimulatedSound:
    """Frames of sound, as they would come from an array in the open.

    Waves are spherical: at the distance r from the source the pressure is its level over r, and
    is there r / c later. For the time of a frame the source stands still where it is now. That
    leaves out the way of the sound, so bearings lag in truth by its speed across over c.

    Parameters
    ----------
    array
        The microphones.
    sample_rate
        Samples a second.
    samples
        Of one frame, N.
    sound
        What there is to be heard.
    seed
        Of the sound and of the noise.

    Raises
    ------
    ValueError
        If there is no frequency in the band of the sound.
    """

    def __init__(
        self, array: MicrophoneArray, sample_rate: float, samples: int, sound: Sound, seed: int
    ) -> None:
        self._array, self._samples, self._sound = array, samples, sound
        # the frame is cut out of a longer piece, so that no delay reaches over its ends
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
        # white noise loses what is outside the band
        self._scale = sound.level / np.sqrt(share)
        self._source, self._noise = stream(seed, 'sound source'), stream(seed, 'microphones')

    def __call__(self, place: Array) -> Array:
        """Return a frame (M, N) while the source is at ``place`` (2,), in m from the array."""
        offsets = place - self._array.positions
        r = np.maximum(np.hypot(*offsets.T), _NEAREST)[:, np.newaxis]
        # what all have in common is left out: who starts to listen does not know it
        later = (r - np.hypot(*place)) / self._array.speed_of_sound
        whole = self._samples + 2 * self._margin
        spectrum = np.fft.rfft(self._scale * self._source.standard_normal(whole)) * self._inside
        waves = spectrum * np.exp(-2j * np.pi * self._frequencies * later) / r
        heard = np.fft.irfft(waves, whole)[:, self._margin : self._margin + self._samples]
        return np.asarray(heard + self._sound.noise * self._noise.standard_normal(heard.shape))
