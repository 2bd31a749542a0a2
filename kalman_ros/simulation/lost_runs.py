# SPDX-License-Identifier: Apache-2.0
"""Which runs are lost: those whose estimate or state ends far from where it should be."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array
from kalman_ros.scenario import Scenario

from .run_statistics import Outcomes

#: How many times farther than at the start a state may be at the end of a run that is not lost.
_LOST = 10.0


def allowed(scenario: Scenario, given: Mapping[str, float] | None) -> Array | None:
    """Return the largest errors (n,) by the names of states; None if none are given.

    Raises
    ------
    ValueError
        If a state is unknown, or an error is not positive.
    """
    if given is None:
        return None
    if not isinstance(given, Mapping):
        raise ValueError(f'lost: expected errors by the name of a state, got {given!r}')
    space = scenario.model.state
    found = np.full(space.size, inf)
    for name, index in zip(given, space.indices(given, 'lost')):
        value = given[name]
        if not isinstance(value, (int, float)) or not value > 0.0:
            raise ValueError(f'lost: expected a positive error of {name}, got {value!r}')
        found[index] = value
    return found


def lost_runs(
    scenario: Scenario, found: Outcomes, target: Array | None, most: Array | None
) -> npt.NDArray[np.bool_]:
    """Return which runs are lost (runs,).

    Parameters
    ----------
    scenario
        Of the plant.
    found
        The outcomes of the runs.
    target
        The state (n,) that is held at the end; None without a controller.
    most
        The largest errors, and distances from the target, at the end (n,); by default ten
        times those of the start, with its standard deviations, or ten deviations as claimed.
    """
    space, std = scenario.model.state, scenario.initial_belief.std
    kept = np.isfinite(found.nees) & np.isfinite(found.squared_error).all(axis=1)
    with np.errstate(invalid='ignore'):
        error = np.abs(found.final_error)
        kept &= (
            error <= (_LOST * np.maximum(std, found.final_std) if most is None else most)
        ).all(axis=1)
        if target is not None:
            start = np.abs(space.subtract(scenario.initial_state, target))
            away = np.abs(space.subtract(found.final_state, target))
            farthest = _LOST * np.maximum(std, start) if most is None else most
            kept &= (away <= farthest).all(axis=1)
    return np.asarray(~kept)
