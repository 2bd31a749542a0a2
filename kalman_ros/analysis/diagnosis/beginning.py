# SPDX-License-Identifier: Apache-2.0
"""From which belief one extended Kalman filter can follow a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from math import inf, log

import numpy as np

from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators.filters.gaussian_sum import HYPOTHESES
from kalman_ros.estimators.mixture import turned_parts

#: Parts whose misfit, -2 log likelihood, is worse by this are given up, looked at after each N
#: readings; after the most of them the best is taken.
_WORSE, _EACH, _MOST = 40.0, 50, 4000


def likeliest(
    belief: Gaussian, space: Space, follow: Callable[[Gaussian], Iterator[float]]
) -> Gaussian:
    """Return the part of a first belief that the readings make likeliest.

    A filter that divides angles which are too uncertain for one Gaussian follows all of its parts
    until one is left; here it is known afterwards which one.

    Parameters
    ----------
    belief
        The first belief.
    space
        Of the state.
    follow
        Yields what each reading adds to the misfit of a filter that begins with a part; raises
        LinAlgError where the filter fails.
    """
    weights, parts = turned_parts(belief, space, HYPOTHESES)
    if len(parts) == 1:
        return belief
    paths = [follow(part) for part in parts]
    misfits = [-2.0 * log(weight) if weight > 0.0 else inf for weight in weights.tolist()]
    count, left = 0, [index for index, misfit in enumerate(misfits) if misfit < inf]
    while len(left) > 1 and count < _MOST:
        count += _EACH
        ended = False
        for index in left:
            try:
                terms = list(islice(paths[index], _EACH))
            except np.linalg.LinAlgError:
                misfits[index] = inf
                continue
            misfits[index] += sum(terms)
            ended = ended or len(terms) < _EACH
        best = min(misfits[index] for index in left)
        left = [index for index in left if misfits[index] < best + _WORSE]
        if ended:
            break
    # infinite is the misfit of all if every filter failed
    return parts[min(left, key=misfits.__getitem__)] if left else belief
