# SPDX-License-Identifier: Apache-2.0
"""The peak of a gain that filter passes compute, by halving."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: How often the interval around the peak is halved.
_HALVINGS = 4


def peak(
    gain: Callable[[float], float], low: float, middle: float, high: float
) -> tuple[float, float, float]:
    """Return the peak of a gain, and a point on either side of it, as (low, peak, high).

    ``gain`` is computed at the middle of the intervals between three points, of which the best one
    and its neighbours remain. It is evaluated twice at some points.
    """
    for _ in range(_HALVINGS):
        near = [0.5 * (low + middle), middle, 0.5 * (middle + high)]
        best = int(np.argmax([gain(point) for point in near]))
        low, middle, high = [low, *near, high][best : best + 3]
    return low, middle, high


def deviation(gain: Callable[[float], float], low: float, best: float, high: float) -> float:
    """Return the standard deviation of a peak, from the side on which the gain falls less.

    The gain is twice a log likelihood, which is a parabola there.
    """
    top = gain(best)
    falls = ((top - gain(point)) / (point - best) ** 2 for point in (low, high))
    return float(max(min(falls), 1e-12) ** -0.5)
