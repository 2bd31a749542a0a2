# SPDX-License-Identifier: Apache-2.0
"""Innovations that are still too large, or correlated in time, after all corrections."""

from __future__ import annotations

from math import inf

import numpy as np

from .examination import Examination
from .finding import Finding
from .noise_levels import innovations

#: Fewest readings, significance in standard deviations, and smallest excess and correlation.
_FEWEST, _FAR, _EXCESS, _CORRELATED = 50, 6.0, 1.25, 0.15


def find(case: Examination) -> list[Finding]:
    """Return a note for each sensor whose innovations are not those of a filter that is right.

    They are white, with the covariance that the filter expects (R. Mehra, On the Identification of
    Variances and Adaptive Kalman Filtering, IEEE Trans. Automatic Control 15(2), 1970).
    """
    notes = []
    for name in case.judged:
        e = case.passage.whitened_of(name)
        reason = _unexpected(np.clip(e, -5.0, 5.0)) if len(e) >= _FEWEST else ''
        if reason:
            notes.append(
                Finding(
                    'unexplained', name,
                    f'innovations of {name} {reason}, also with all findings corrected: something '
                    'is wrong that has no name here.',
                    inf, note=True, figure=innovations(case, name, 0),
                )
            )  # fmt: skip
    return notes


def _unexpected(e: np.ndarray) -> str:
    """Return what is unexpected of whitened innovations (N, k); '' of white ones."""
    N, k = e.shape
    excess = float(np.mean(e * e))
    if excess > _EXCESS and (excess - 1.0) * np.sqrt(0.5 * N * k) > _FAR:
        return f'are {excess**0.5:.2g} times as large as the filter expects'
    r = np.mean(e[1:] * e[:-1], axis=0) / np.mean(e * e, axis=0)
    worst = float(r[np.argmax(np.abs(r))])
    if abs(worst) > _CORRELATED and abs(worst) * np.sqrt(N) > _FAR:
        return f'are correlated from one reading to the next ({worst:+.2f})'
    return ''
