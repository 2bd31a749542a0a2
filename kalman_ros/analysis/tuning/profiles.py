# SPDX-License-Identifier: Apache-2.0
"""Profiles of the likelihood on both sides of a fitted value, with the others adapted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array

from .fit import Fit
from .likelihood import Likelihood

#: Points on each side of the value, in standard deviations.
_REACH = (0.75, 1.5, 2.25, 3.0)


@dataclass(frozen=True)
class Profile:
    """The log-likelihood along one parameter, minus the log-likelihood of the fit.

    Parameters
    ----------
    name, unit
        Name and unit of the parameter.
    value
        Values of the parameter (N,).
    drop
        Change of the log-likelihood (N,), which is -1.92 at the ends of a 95 % interval.
    expected
        Change for a normal distribution with the interval of the fit (N,).
    """

    name: str
    unit: str
    value: Array
    drop: Array
    expected: Array


def profiles(likelihood: Likelihood, fit: Fit) -> list[Profile]:
    """Return the profile of each parameter with an interval by its information.

    The other parameters follow the ridge of the normal approximation, so the magnitude of each
    drop is an upper bound for that of the exact profile.
    """
    determined = np.flatnonzero(np.isfinite(fit.determination.std)).tolist()
    offsets = np.array([*(-r for r in reversed(_REACH)), 0.0, *_REACH])
    std = fit.determination.std
    points, limits = [], np.array([free.limits for free in likelihood.parameters])
    for index in determined:
        ridge = np.where(np.isfinite(std), fit.correlation[index] * std, 0.0)
        points += [np.clip(fit.top.z + a * ridge, limits[:, 0], limits[:, 1]) for a in offsets]
    if not points:
        return []
    drops = (likelihood.values(points) - fit.top.value).reshape(len(determined), len(offsets))
    results = []
    for row, index in enumerate(determined):
        parameter, z = likelihood.parameters[index], float(fit.top.z[index])
        value = np.array([parameter.value(z + a * float(std[index])) for a in offsets])
        results.append(
            Profile(parameter.name, parameter.unit, value, drops[row], -0.5 * offsets**2)
        )
    return results
