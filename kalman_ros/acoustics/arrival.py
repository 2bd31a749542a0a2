# SPDX-License-Identifier: Apache-2.0
"""The direction of one source of sound, with its variance.

With X (M,) the spectrum at M microphones at one frequency and a (M,) the phases of a plane wave,
a band of K frequencies has the coherence

    gamma = sum |a* X|^2 / (M sum |X|^2)

with a bearing, a sufficient statistic if the powers of source and noise are unknown. With noise
of equal power and a source psi times as strong in a beam, with the noise's prior 1 / power
integrated out, sound from this bearing is more likely than noise alone by the factor

    (1 + psi)^-K (1 - gamma psi / (1 + psi))^-KM

(J. Bohme, Estimation of Spectral Parameters of Correlated Signals in Wavefields, Signal
Processing 11, 1986, has the likelihood at its maximum). Averaged over a prior of psi and
multiplied over the bands it is the density of the bearing. So a band counts by its content of the
source, and a lobe as high as the peak widens the variance as it should.

It holds for one distant source, and for noise that is independent between microphones and equal
in all of them. Echoes are not modelled.
"""

from __future__ import annotations

from math import ceil, pi
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array

from .array import MicrophoneArray

#: Number of frequencies per band: enough to average their squares, few enough to be similar.
_PER_BAND = 32
#: Ratios of source to noise in a beam, equally likely: -10 to 59 dB, in fine steps.
_RATIOS = 10.0 ** (np.arange(-10.0, 60.0, 3.0) / 10.0)[:, np.newaxis, np.newaxis]
#: Share of a frame over which it fades in and out.
_FADE = 0.1
#: Number of harmonics of a beam beyond the size of the array in wavelengths, which decay at once.
_SPARE = 8
#: Number of directions of the integral per direction of a beam.
_FINER = 8
#: A peak narrower than this many steps is refined, over N steps to either side.
_LEAST_STEPS = 2.0
_NEAR = 16
_CLOSER = 4


class Arrival(NamedTuple):
    """The direction of a sound.

    Parameters
    ----------
    bearing
        Bearing from the array's x axis towards its y axis, in [-pi, pi).
    variance
        Variance of the bearing, in rad^2.
    evidence
        Logarithm of the odds of a source against noise alone. Noise alone reaches
        ``log(q)`` in at most one frame of q (by Markov's inequality).
    """

    bearing: float
    variance: float
    evidence: float


class DirectionFinder:
    """Estimator of the bearing of the only source near an array.

    Parameters
    ----------
    array
        The microphones.
    sample_rate
        Samples per second.
    samples
        Number of samples N of one frame.
    band
        Lowest and highest frequency in use, in Hz.

    Raises
    ------
    ValueError
        If a frame has too few frequencies in the band.
    """

    def __init__(
        self, array: MicrophoneArray, sample_rate: float, samples: int, band: tuple[float, float]
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
        # neighbouring frequencies of a tapered frame are correlated
        blur = np.mean(self._taper**4) / np.mean(self._taper**2) ** 2
        self._independent: Array = np.diff(edges)[:, np.newaxis] / blur
        inner = np.asarray(frequencies[inside], dtype=float)
        size = 2.0 * pi * inner[-1] / array.speed_of_sound * array.radius
        directions = 2 * (ceil(2.0 * size) + _SPARE) + 1
        self._steering = array.steering(inner, _around(directions)).conj()

    def __call__(self, frame: Array) -> Arrival:
        """Return the direction of the sound in a frame (M, N)."""
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
        """Return gamma (B, G) of each band, in enough directions to interpolate."""
        X = np.fft.rfft(self._taper * frame)[:, self._chosen].T
        beams = np.abs(np.einsum('kgm,km->kg', self._steering, X)) ** 2
        power = self._microphones * np.sum(np.abs(X) ** 2, axis=1, keepdims=True)
        beams, power = (np.add.reduceat(values, self._starts) for values in (beams, power))
        gamma: Array = np.divide(beams, power, out=np.zeros_like(beams), where=power > 0.0)
        return gamma

    def _log_density(self, beams: Array, bearings: Array) -> Array:
        """Return the log odds (N,) of sound from each bearing against noise alone."""
        # a beam is periodic and smooth, so its Fourier series is exact
        series = np.fft.rfft(beams) / beams.shape[1]
        series[:, 1:] *= 2.0
        waves = np.exp(1j * np.multiply.outer(np.arange(series.shape[1]), bearings))
        gamma = (series @ waves).real
        K, M, psi = self._independent, self._microphones, _RATIOS
        factors = -K * (np.log1p(psi) + M * np.log1p(-gamma * psi / (1.0 + psi)))
        return np.asarray(_log_mean(factors).sum(axis=0))


def _around(count: int) -> Array:
    """Return N equally spaced directions."""
    return np.asarray(2.0 * pi * np.arange(count) / count, dtype=float)


def _taper(samples: int) -> Array:
    """Return weights (N,) that fade in and out as a squared sine."""
    place = (np.arange(samples) + 0.5) / samples
    fade = np.minimum(1.0, np.minimum(place, 1.0 - place) / _FADE)
    return np.asarray(np.sin(0.5 * pi * fade) ** 2)


def _log_mean(logs: Array) -> Array:
    """Return the logarithm of the mean, over the first axis, from logarithms."""
    most = logs.max(axis=0)
    return np.asarray(most + np.log(np.exp(logs - most).mean(axis=0)))


def _moments(bearings: Array, log_density: Array) -> tuple[float, float]:
    """Return the mean and the variance of a bearing from its density at equal steps."""
    weights = np.exp(log_density - np.max(log_density))
    weights /= weights.sum()
    mean = float(np.angle(weights @ np.exp(1j * bearings)))
    off = (bearings - mean + pi) % (2.0 * pi) - pi
    return mean, float(weights @ off**2)
