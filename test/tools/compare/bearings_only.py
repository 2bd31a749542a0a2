# SPDX-License-Identifier: Apache-2.0
"""Bearings only: Leong, Arulampalam, Lamahewa and Abhayapala (2014), the moderate scenario.

A target at 5 km on a constant course is tracked for 32 minutes by its bearing. The own ship keeps
its course until step 12 and turns in four equal steps from 13 to 16.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalman_ros import scenario
from kalman_ros.core import Array, Gaussian
from kalman_ros.scenario import Scenario

STEP, STEPS = 60.0, 32
SIGMA_BEARING = float(np.radians(1.5))
#: In m, in m/s and in rad.
SIGMA_RANGE, SIGMA_SPEED, SIGMA_COURSE = 2000.0, 2.0 * 0.514, np.pi / np.sqrt(12.0)
#: East and north of the own ship, in m.
TARGET = np.array([4920.0, 850.0])
#: In m/s and degrees.
_SPEED, _COURSE = 4.0 * 0.514, -140.0
_OWN_SPEED = 5.0 * 0.514
_NEAREST = 1000.0


def velocity(speed: float, course: float) -> Array:
    """Return the velocity east and north of a course, in degrees clockwise from north."""
    return speed * np.array([np.sin(np.radians(course)), np.cos(np.radians(course))])


def own_velocity(step: int) -> Array:
    """Return the velocity of the own ship before a step."""
    return velocity(_OWN_SPEED, 140.0 - 30.0 * min(max(step - 12, 0), 4))


def manoeuvre(time: float) -> Array:
    """Return the acceleration of the own ship from a time on, for one step."""
    step = round(time / STEP)
    return (own_velocity(step + 1) - own_velocity(step)) / STEP


def prior(distance: float, bearing: float, speed: float, course: float, width: float) -> Gaussian:
    """Return the belief from a distance, a bearing, a speed and a course.

    ``width`` is the uncertainty of all but the bearing, relative to the published one.
    """
    line = np.array([np.cos(bearing), np.sin(bearing)])
    across = np.array([-line[1], line[0]])
    ahead = velocity(1.0, course)
    aside = np.array([ahead[1], -ahead[0]])
    P = np.zeros((4, 4))
    P[:2, :2] = (width * SIGMA_RANGE) ** 2 * np.outer(line, line)
    P[:2, :2] += (distance * SIGMA_BEARING) ** 2 * np.outer(across, across)
    P[2:, 2:] = (width * SIGMA_SPEED) ** 2 * np.outer(ahead, ahead)
    P[2:, 2:] += (width * speed * SIGMA_COURSE) ** 2 * np.outer(aside, aside)
    return Gaussian(
        np.concatenate((distance * line, velocity(speed, course) - own_velocity(0))), P
    )


def moderate(width: float = 1.0) -> Scenario:
    """Return the scenario, with a correct initial belief."""
    start = np.concatenate((TARGET, velocity(_SPEED, _COURSE) - own_velocity(0)))
    built = scenario.build(
        {
            'model': 'bearing_tracker',
            'model_parameters.acceleration_noise': 9e-6,
            'rate': 1.0 / STEP,
            'bearing.rate': 1.0 / STEP,
            'bearing.noise': SIGMA_BEARING,
            'initial_state': start.tolist(),
        }
    )
    belief = prior(*_true(), _SPEED, _COURSE, width)
    return replace(built, initial_belief=belief)


def drawn(rng: np.random.Generator, width: float = 1.0) -> Gaussian:
    """Return an initial belief with an error drawn from its covariance."""
    distance, bearing = _true()
    return prior(
        max(distance + width * SIGMA_RANGE * rng.normal(), _NEAREST),
        bearing + SIGMA_BEARING * rng.normal(),
        _SPEED + width * SIGMA_SPEED * rng.normal(),
        _COURSE + width * np.degrees(SIGMA_COURSE) * rng.normal(),
        width,
    )


def _true() -> tuple[float, float]:
    x, y = TARGET
    return float(np.hypot(x, y)), float(np.arctan2(y, x))
