# SPDX-License-Identifier: Apache-2.0
"""Microphones in a plane, and the delays of a sound at each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array, ArrayLike

ComplexArray = npt.NDArray[np.complex128]

#: Speed of sound in air of 20 degrees C, in m/s.
SPEED_OF_SOUND = 343.0


@dataclass(frozen=True)
class MicrophoneArray:
    """Omnidirectional microphones at known positions.

    Parameters
    ----------
    positions
        Coordinates x and y of each microphone from the array's centre (M, 2), in m; a flat list is
        accepted. Three or more, not all in a line, which would leave left and right ambiguous.
    speed_of_sound
        Speed of sound in m/s.

    Raises
    ------
    ValueError
        If the positions are invalid, or the speed is not positive.
    """

    positions: Array
    speed_of_sound: float = SPEED_OF_SOUND

    def __post_init__(self) -> None:
        object.__setattr__(self, 'positions', _plane(self.positions))
        if not self.speed_of_sound > 0.0:
            raise ValueError(
                f'speed_of_sound: expected a positive number, got {self.speed_of_sound:g}'
            )

    @property
    def size(self) -> int:
        """Number of microphones M."""
        return len(self.positions)

    @property
    def radius(self) -> float:
        """Distance of the outermost microphone from the centre, in m."""
        return float(np.hypot(*self.positions.T).max())

    def steering(self, frequencies: Array, bearings: Array) -> ComplexArray:
        """Return the phases (K, G, M) of a plane wave at the microphones.

        They are exp(i 2 pi f u . p / c) for a wave from the direction u: a microphone closer to
        the source receives it earlier.

        Parameters
        ----------
        frequencies
            Frequencies in Hz (K,).
        bearings
            Bearings from the x axis towards the y axis, in rad (G,).
        """
        lead = _unit(bearings) @ self.positions.T / self.speed_of_sound
        return np.asarray(np.exp(2j * np.pi * np.multiply.outer(frequencies, lead)))


def _unit(bearings: Array) -> Array:
    """Return the vectors (..., 2) of length one in the direction of ``bearings``."""
    return np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)


def _plane(value: ArrayLike) -> Array:
    """Return positions (M, 2) that span the plane, or raise ValueError."""
    positions = np.array(value, dtype=float)
    if positions.size % 2 or positions.size < 6 or not np.isfinite(positions).all():
        raise ValueError(
            'microphones: expected x and y of three or more, all finite, '
            f'got {positions.size} numbers'
        )
    positions = positions.reshape(-1, 2)
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-6 * spread[0] or spread[0] == 0.0:
        raise ValueError('microphones: expected not all on one line, which leaves two directions')
    return positions
