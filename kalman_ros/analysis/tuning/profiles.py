# SPDX-License-Identifier: Apache-2.0
"""How the likelihood falls on both sides of a fitted value, the others following."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array

from .fit import Fit
from .likelihood import Likelihood

#: Points on each side, in standard deviations.
_REACH = (0.75, 1.5, 2.25, 3.0)


@dataclass(frozen=True)
class Profile:
    """The log-likelihood along one parameter, minus that of the fit.

    Parameters
    ----------
    name, unit
        Of the parameter.
    value
        (N,).
    drop
        Of the log-likelihood (N,): -1.92 at the ends of a 95 % interval.
    expected
        The same of a normal distribution with the interval of the fit (N,).
    """

    name: str
    unit: str
    value: Array
    drop: Array
    expected: Array


def profiles(likelihood: Likelihood, found: Fit) -> list[Profile]:
    """Return the profile of each parameter that is determined.

    The others follow along the ridge of the normal approximation, so each drop is an upper bound
    of that of the profile.
    """
    known = [i for i, each in enumerate(found.parameters) if each.determined]
    away = np.array([*(-r for r in reversed(_REACH)), 0.0, *_REACH])
    std = found.determination.std
    points, limits = [], np.array([each.limits for each in likelihood.parameters])
    for index in known:
        ridge = np.where(np.isfinite(std), found.correlation[index] * std, 0.0)
        points += [np.clip(found.top.z + a * ridge, limits[:, 0], limits[:, 1]) for a in away]
    if not points:
        return []
    drops = (likelihood.values(points) - found.top.value).reshape(len(known), len(away))
    shapes = []
    for row, index in enumerate(known):
        parameter, z = likelihood.parameters[index], float(found.top.z[index])
        value = np.array([parameter.value(z + a * float(std[index])) for a in away])
        shapes.append(Profile(parameter.name, parameter.unit, value, drops[row], -0.5 * away**2))
    return shapes
