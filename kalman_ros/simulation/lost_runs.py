# SPDX-License-Identifier: Apache-2.0
"""Detection of lost runs: their estimate or state ends far from where it should be."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
import numpy.typing as npt

from kalman_ros.core import Array
from kalman_ros.scenario import Scenario

from .run_statistics import Outcomes

#: Factor of the distance at the start, above which a state at the end means that a run is lost.
_LOST = 10.0


def allowed(scenario: Scenario, errors: Mapping[str, float] | None) -> Array | None:
    """Return the largest errors (n,), from ``errors`` by the names of states; None without any.

    Raises
    ------
    ValueError
        If a state is unknown, or an error is not positive.
    """
    if errors is None:
        return None
    if not isinstance(errors, Mapping):
        raise ValueError(f'lost: expected errors by the name of a state, got {errors!r}')
    space = scenario.model.state
    limits = np.full(space.size, inf)
    for name, index in zip(errors, space.indices(errors, 'lost')):
        value = errors[name]
        if not isinstance(value, (int, float)) or not value > 0.0:
            raise ValueError(f'lost: expected a positive error of {name}, got {value!r}')
        limits[index] = value
    return limits


def lost_runs(
    scenario: Scenario, outcomes: Outcomes, target: Array | None, most: Array | None
) -> npt.NDArray[np.bool_]:
    """Return the mask (runs,) of the runs that are lost.

    Parameters
    ----------
    scenario
        Scenario of the plant.
    outcomes
        Outcomes of the runs.
    target
        State (n,) that is held at the end; None without a controller.
    most
        Largest errors, and distances from the target, at the end (n,); by default ten
        times those of the start, with its standard deviations, or ten deviations as claimed.
    """
    space, std = scenario.model.state, scenario.initial_belief.std
    kept = np.isfinite(outcomes.nees) & np.isfinite(outcomes.squared_error).all(axis=1)
    with np.errstate(invalid='ignore'):
        error = np.abs(outcomes.final_error)
        kept &= (
            error <= (_LOST * np.maximum(std, outcomes.final_std) if most is None else most)
        ).all(axis=1)
        if target is not None:
            start = np.abs(space.subtract(scenario.initial_state, target))
            away = np.abs(space.subtract(outcomes.final_state, target))
            farthest = _LOST * np.maximum(std, start) if most is None else most
            kept &= (away <= farthest).all(axis=1)
    return np.asarray(~kept)
