# SPDX-License-Identifier: Apache-2.0
"""The initial belief from which one extended Kalman filter can follow a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from math import inf, log

import numpy as np

from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators.filters.gaussian_sum import HYPOTHESES
from kalman_ros.estimators.mixture import turned_parts

#: A part is abandoned if its misfit, -2 log likelihood, exceeds the least misfit by this. Misfits
#: are compared after each block of readings, and the best part is chosen after the last block.
_MUCH_WORSE, _BLOCK, _MOST_READINGS = 40.0, 50, 4000


def likeliest(
    belief: Gaussian, space: Space, follow: Callable[[Gaussian], Iterator[float]]
) -> Gaussian:
    """Return the part of an initial belief that the readings make likeliest.

    A filter that splits angles that are too uncertain for one Gaussian follows all parts until one
    is left. A recording shows afterwards which part that is.

    Parameters
    ----------
    belief
        Initial belief.
    space
        Space of the state.
    follow
        Function that yields the term of each reading in the misfit of a filter that begins with a
        part, and raises LinAlgError if the filter fails.
    """
    weights, parts = turned_parts(belief, space, HYPOTHESES)
    if len(parts) == 1:
        return belief
    passes = [follow(part) for part in parts]
    misfits = [-2.0 * log(weight) if weight > 0.0 else inf for weight in weights.tolist()]
    count, remaining = 0, [index for index, misfit in enumerate(misfits) if misfit < inf]
    while len(remaining) > 1 and count < _MOST_READINGS:
        count += _BLOCK
        exhausted = False
        for index in remaining:
            try:
                terms = list(islice(passes[index], _BLOCK))
            except np.linalg.LinAlgError:
                misfits[index] = inf
                continue
            misfits[index] += sum(terms)
            exhausted = exhausted or len(terms) < _BLOCK
        best = min(misfits[index] for index in remaining)
        remaining = [index for index in remaining if misfits[index] < best + _MUCH_WORSE]
        if exhausted:
            break
    # no part remains if every filter failed
    return parts[min(remaining, key=misfits.__getitem__)] if remaining else belief
