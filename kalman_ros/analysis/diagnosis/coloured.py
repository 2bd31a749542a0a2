# SPDX-License-Identifier: Apache-2.0
"""Noise of a sensor that is correlated in time, where it is declared to be white."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array

from . import wandering
from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .noise_levels import innovations

#: Fewest readings of the sensor, and most readings of the pass: each trial is a filter pass.
_FEWEST, _LONGEST = 100, 20_000
#: Mean squares of whitened innovations between which noise has about its declared size; below the
#: first one, or if successive ones are correlated by more than the third number, it is suspected.
_SMALL, _LARGE, _CORRELATED = 0.8, 1.3, 0.15
#: Significance of either, in standard deviations.
_FAR = 6.0
#: It must explain this many times as much as smaller noise that is white about a constant.
_BETTER = 1.2
#: Seed of the white noise in place of the correlated one.
_SEED = 2


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors whose errors are alike from one reading to the next.

    The noise has its declared size, and decays with a time constant. To a filter that takes it for
    white, it is a state, so that the innovations are too small, or correlated.
    """
    if len(case.passage.events) > _LONGEST or case.passage.mean_square > _LARGE:
        return
    for name in case.judged:
        e = case.passage.whitened_of(name)
        if len(e) < _FEWEST or not _is_suspect(e):
            continue
        R = np.median(case.evidence.sensors[name].covariance, axis=0)
        try:
            gain, time, path = wandering.coloured(case.passage, name, R)
            least = _BETTER * wandering.whiter(case.passage, name, R)
        except np.linalg.LinAlgError:  # noise of next to no size
            continue
        if gain > max(CHANCE, least):
            yield _coloured(case, name, gain, time, path)


def _is_suspect(e: Array) -> bool:
    """Return whether whitened innovations (N, k) are smaller than expected, or alike in time."""
    N, k = e.shape
    size = float(np.mean(e * e))
    if not 0.0 < size <= _LARGE:
        return False
    r = float(np.max(np.mean(e[1:] * e[:-1], axis=0))) / size
    small = size < _SMALL and (1.0 - size) * np.sqrt(0.5 * N * k) > _FAR
    return small or (r > _CORRELATED and r * np.sqrt(N) > _FAR)


def _coloured(case: Examination, name: str, gain: float, time: float, path: Array) -> Finding:
    """Return the finding that the noise of a sensor is correlated over a ``time`` in s."""

    def mended() -> Evidence:
        """Return the evidence with white noise of the same size."""
        rows, record = case.passage.series('index', name), case.evidence.sensors[name]
        roots = np.linalg.cholesky(record.covariance[rows])
        white = np.random.default_rng(_SEED).standard_normal((*path.shape, 1))
        value = record.value.copy()
        value[rows] += (roots @ white)[:, :, 0] - path
        return case.evidence.with_values(name, value)

    return Finding(
        'coloured noise', name,
        f'errors of {name} are alike for about {time:.2g} s, where its noise is declared to be '
        'white. The filter takes each reading for news, and is surer than it should be: let it '
        'follow them (bias_std), or declare more noise.',
        gain**0.5, gain=gain, is_exact=True, figure=innovations(case, name, 0), mended=mended,
        absorbs=True,
    )  # fmt: skip
