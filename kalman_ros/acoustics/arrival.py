# SPDX-License-Identifier: Apache-2.0
"""The direction of one source of sound, with the variance that the sound itself tells.

With X (M,) the spectrum at M microphones at one frequency and a (M,) the phases of a plane wave,
a band of K frequencies has the coherence

    gamma = sum |a* X|^2 / (M sum |X|^2)

with a bearing: all that it says of it, if the powers of source and noise are unknown. With noise
of one power and a source psi times as strong in a beam, where the prior 1 / power of the noise is
integrated out, sound from this bearing is likelier than noise alone by the factor

    (1 + psi)^-K (1 - gamma psi / (1 + psi))^-KM

(J. Bohme, Estimation of Spectral Parameters of Correlated Signals in Wavefields, Signal
Processing 11, 1986, has the likelihood at its maximum). Averaged over a prior of psi and
multiplied over the bands it is the density of the bearing. So a band weighs as much as it hears
of the source, and a lobe that cannot be told from the peak widens the variance as it should.

It holds for one source, far away against the size of the array, and for noise that is
independent between microphones and alike in all of them. Echoes are not in it.
"""

from __future__ import annotations

from math import ceil, pi
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array

from .array import MicrophoneArray

#: Frequencies a band: enough to know their mean square well, few enough to be alike.
_PER_BAND = 32
#: Of source to noise in a beam, all as likely: -10 to 59 dB, in steps that the data blur.
_RATIOS = 10.0 ** (np.arange(-10.0, 60.0, 3.0) / 10.0)[:, np.newaxis, np.newaxis]
#: The share of a frame over which it fades in and out: a wave is not at both ends at once.
_FADE = 0.1
#: Harmonics of a beam beyond the size of the array in wavelengths, which fall off at once.
_SPARE = 8
#: Directions of the integral for one that a beam is known from.
_FINER = 8
#: A peak of fewer steps than this is refined, over N steps to either side.
_LEAST_STEPS = 2.0
_NEAR = 16
_CLOSER = 4


class Arrival(NamedTuple):
    """Where a sound comes from.

    Parameters
    ----------
    bearing
        From the array's x axis towards its y axis, in [-pi, pi).
    variance
        Of the bearing, in rad^2.
    evidence
        The logarithm of how much likelier a source is than noise alone. Noise alone reaches
        ``log(q)`` in at most one frame of q (by Markov's inequality).
    """

    bearing: float
    variance: float
    evidence: float


class DirectionFinder:
    """Finds the bearing of the one source that an array hears.

    Parameters
    ----------
    array
        The microphones.
    sample_rate
        Samples a second.
    samples
        Of one frame, N.
    band
        The lowest and the highest frequency that are listened to, in Hz.

    Raises
    ------
    ValueError
        If a frame has too few frequencies in the band.
    """

    def __init__(
        self,
        array: MicrophoneArray,
        sample_rate: float,
        samples: int,
        band: tuple[float, float],
    ) -> None:
        frequencies = np.fft.rfftfreq(samples, 1.0 / sample_rate)
        low, high = band
        inside = np.flatnonzero((low <= frequencies) & (frequencies <= high) & (frequencies > 0))
        bands = len(inside) // _PER_BAND
        if not bands:
            raise ValueError(
                f'band: expected {_PER_BAND} frequencies of a frame or more, '
                f'got {len(inside)} from {low:g} to {high:g} Hz'
            )
        self._chosen = inside
        self._microphones = array.size
        self._taper = _taper(samples)
        edges = np.linspace(0, len(inside), bands + 1).astype(int)
        self._starts = edges[:-1]
        # neighbouring frequencies of a tapered frame tell a little of each other
        blur = np.mean(self._taper**4) / np.mean(self._taper**2) ** 2
        self._independent: Array = np.diff(edges)[:, np.newaxis] / blur
        heard = np.asarray(frequencies[inside], dtype=float)
        size = 2.0 * pi * heard[-1] / array.speed_of_sound * array.radius
        directions = 2 * (ceil(2.0 * size) + _SPARE) + 1
        self._steering = array.steering(heard, _around(directions)).conj()

    def __call__(self, frame: Array) -> Arrival:
        """Return where the sound of a frame (M, N) comes from."""
        beams = self._beams(frame)
        bearings = _around(_FINER * beams.shape[1])
        density = self._log_density(beams, bearings)
        bearing, variance = _moments(bearings, density)
        evidence = float(_log_mean(density))
        step = 2.0 * pi / len(bearings)
        around = np.arange(-_NEAR * _CLOSER, _NEAR * _CLOSER + 1, dtype=float)
        while variance < (_LEAST_STEPS * step) ** 2:
            step /= _CLOSER
            near = bearing + step * around
            bearing, variance = _moments(near, self._log_density(beams, near))
        return Arrival((bearing + pi) % (2.0 * pi) - pi, variance, evidence)

    def _beams(self, frame: Array) -> Array:
        """Return gamma (B, G) of each band, in as many directions as tell all others."""
        X = np.fft.rfft(self._taper * frame)[:, self._chosen].T
        heard = np.abs(np.einsum('kgm,km->kg', self._steering, X)) ** 2
        power = self._microphones * np.sum(np.abs(X) ** 2, axis=1, keepdims=True)
        heard, power = (np.add.reduceat(each, self._starts) for each in (heard, power))
        gamma: Array = np.divide(heard, power, out=np.zeros_like(heard), where=power > 0.0)
        return gamma

    def _log_density(self, beams: Array, bearings: Array) -> Array:
        """Return the logarithm (N,) of how much likelier sound from there is than noise alone."""
        # a beam is periodic and smooth, so its Fourier series is exact
        series = np.fft.rfft(beams) / beams.shape[1]
        series[:, 1:] *= 2.0
        waves = np.exp(1j * np.multiply.outer(np.arange(series.shape[1]), bearings))
        gamma = (series @ waves).real
        K, M, psi = self._independent, self._microphones, _RATIOS
        factors = -K * (np.log1p(psi) + M * np.log1p(-gamma * psi / (1.0 + psi)))
        return np.asarray(_log_mean(factors).sum(axis=0))


def _around(count: int) -> Array:
    """Return N directions, evenly around."""
    return np.asarray(2.0 * pi * np.arange(count) / count, dtype=float)


def _taper(samples: int) -> Array:
    """Return weights (N,) that fade in and out as a squared sine."""
    place = (np.arange(samples) + 0.5) / samples
    fade = np.minimum(1.0, np.minimum(place, 1.0 - place) / _FADE)
    return np.asarray(np.sin(0.5 * pi * fade) ** 2)


def _log_mean(logs: Array) -> Array:
    """Return the logarithm of the mean of what has these logarithms, over the first axis."""
    most = logs.max(axis=0)
    return np.asarray(most + np.log(np.exp(logs - most).mean(axis=0)))


def _moments(bearings: Array, log_density: Array) -> tuple[float, float]:
    """Return the mean and the variance of a bearing from its density at equal steps."""
    weights = np.exp(log_density - np.max(log_density))
    weights /= weights.sum()
    mean = float(np.angle(weights @ np.exp(1j * bearings)))
    off = (bearings - mean + pi) % (2.0 * pi) - pi
    return mean, float(weights @ off**2)
