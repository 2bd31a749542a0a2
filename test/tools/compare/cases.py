# SPDX-License-Identifier: Apache-2.0
"""Hard cases for filters: nonlinear, with any initial uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kalman_ros import scenario
from kalman_ros.core import Array, Gaussian
from kalman_ros.scenario import Scenario

from . import bearings_only


@dataclass(frozen=True)
class Case:
    """A problem with any initial uncertainty.

    Parameters
    ----------
    name
        For people.
    start
        Returns, for a width and random numbers, a scenario with its truth and its initial belief,
        which differ by that uncertainty.
    widths
        The initial uncertainties, relative to the scenario's, and as text.
    seconds
        The length of a run.
    measured
        The names of the states whose error counts, together, in ``unit``.
    lost
        A run with a larger error at the end has lost track.
    command
        The input at a time.
    """

    name: str
    start: Callable[[float, np.random.Generator], Scenario]
    widths: Mapping[float, str]
    seconds: float
    measured: Sequence[str]
    unit: str
    lost: float
    command: Callable[[float], Array] | None = None


def _drawn(values: Mapping[str, Any]) -> Callable[[float, np.random.Generator], Scenario]:
    """Return a start whose truth is drawn from the initial belief."""
    built = scenario.build(values)

    def start(width: float, rng: np.random.Generator) -> Scenario:
        mean, P = built.initial_belief.mean, width**2 * built.initial_belief.covariance
        drawn, state = rng.multivariate_normal(mean, P, method='cholesky'), built.model.state
        truth = state.wrap(state.reached(drawn, mean))
        return replace(built, initial_state=truth, initial_belief=Gaussian(mean, P))

    return start


def _moderate(width: float, rng: np.random.Generator) -> Scenario:
    """Return the published scenario with its truth and a drawn belief."""
    belief = bearings_only.drawn(rng, width)
    return replace(bearings_only.moderate(), initial_belief=belief)


CASES = {
    'bearings_only': Case(
        'bearings only',
        _moderate,
        {0.25: 'range 0.5 km', 1.0: 'range 2 km, as published', 2.0: 'range 4 km'},
        bearings_only.STEPS * bearings_only.STEP,
        ('x', 'y'),
        'm',
        1000.0,
        bearings_only.manoeuvre,
    ),
    'range_bearing': Case(
        'range and bearing',
        _drawn(
            {
                'model': 'constant_velocity',
                'model_parameters.acceleration_noise': 0.01,
                'rate': 10.0,
                'sensors': ['radar'],
                'radar.rate': 5.0,
                # an accurate range, an inaccurate bearing, and nearly no range rate
                'radar.noise': [0.3, 0.2, 1000.0],
                'initial_estimate': [30.0, 0.0, 0.0, 0.0],
                'initial_std': [1.0, 1.0, 0.3, 0.3],
            }
        ),
        {3.0: 'position 3 m', 18.0: 'position 18 m', 30.0: 'position 30 m'},
        10.0,
        ('x', 'y'),
        'm',
        10.0,
    ),
    'pole': Case(
        'pole at large angles',
        _drawn(
            {
                'model': 'cart_pole',
                'rate': 25.0,
                # the angle is observed only by its effect on the cart
                'joint_states.measures': ['x'],
                'joint_states.fields': ['position[cart]'],
                'joint_states.noise': [0.005],
                'joint_states.rate': 25.0,
                'initial_estimate': [0.0, 0.0, 3.14159, 0.0],
                'initial_std': [0.05, 0.05, 1.0, 3.0],
            }
        ),
        {0.3: 'angle 0.3 rad', 0.9: 'angle 0.9 rad', 1.5: 'angle 1.5 rad'},
        3.0,
        ('theta',),
        'rad',
        0.5,
    ),
}
