# SPDX-License-Identifier: Apache-2.0
"""Reproducible noise: every source has its own named stream, from one seed."""

from __future__ import annotations

from zlib import crc32

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.batched import semidefinite_factor


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the stream of random numbers of a source.

    It depends only on the seed and the source's name, so adding, dropping or changing one
    source does not affect the others.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()),))
    return np.random.Generator(np.random.PCG64(sequence))


class NoiseSource:
    """Source of draws from N(0, covariance), with a private `stream`."""

    def __init__(self, seed: int, name: str) -> None:
        self._generator = stream(seed, name)
        self._covariance: Array | None = None
        self._factor: Array

    def draw(self, covariance: Array) -> Array:
        """Return one draw (n,) from a positive semi-definite ``covariance`` (n, n)."""
        if covariance is not self._covariance:
            self._covariance, self._factor = covariance, root(covariance)
        return np.asarray(self._factor @ self._generator.standard_normal(len(self._factor)))

    def draw_varying(self, covariance: Array) -> Array:
        """Return one draw (n,) from a ``covariance`` that differs at every draw.

        It uses a factor that changes no more than the covariance does: the eigenvectors of `root`
        are arbitrary where eigenvalues are close, so that rounding would decide the draw.
        """
        factor = semidefinite_factor(covariance)
        return np.asarray(factor @ self._generator.standard_normal(len(factor)))


def root(covariance: Array) -> Array:
    """Return a matrix M with M M' = covariance; zero variances are allowed."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
