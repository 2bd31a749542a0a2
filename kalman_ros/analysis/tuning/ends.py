# SPDX-License-Identifier: Apache-2.0
"""Ends of 95 % intervals by the profile of the likelihood, where it is not a parabola.

An end is where the profile is lower than the maximum by half the quantile of chi-square with one
degree of freedom, 1.92 (Y. Pawitan, In All Likelihood, 2001, section 3.4).
"""

from __future__ import annotations

from math import inf

import numpy as np

from kalman_ros.core import Array

from .ascent import scoring_step
from .likelihood import Expansion, Likelihood

#: Distances from the maximum at which the profile is computed, as shares of a width.
_SHARES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 16.0)
#: Longest distance on a logarithmic scale, a factor of 10,000.
_FARTHEST = 9.2
#: Number of standard deviations of a normal distribution at the ends of a 95 % interval.
_END = 1.96
#: Damping of the steps of the other parameters.
_DAMPING = 1e-6


def ends(
    likelihood: Likelihood, top: Expansion, index: int, width: float, about: float | None = None
) -> tuple[float, float]:
    """Return the ends of the interval of a parameter, on the scale of the fit.

    An end is infinite where the profile does not fall by 1.92 up to the bound of the parameter.

    Parameters
    ----------
    likelihood, top
        Likelihood and its maximum.
    index
        Index of the parameter.
    width
        Width on the scale of the fit to which the distances are proportional.
    about
        Value on the scale of the fit that is as likely as the maximum, if not there.
    """
    middle = float(top.z[index]) if about is None else about
    free = likelihood.parameters[index]
    low, high = free.limits
    farthest = _FARTHEST if free.positive else inf
    offsets = [min(share * width, farthest) for share in _SHARES]
    sides = [
        sorted({min(max(middle + sign * offset, low), high) for offset in offsets},
               key=lambda z: abs(z - middle))
        for sign in (-1.0, 1.0)
    ]  # fmt: skip
    points = [_at(top.z, index, z) for side in sides for z in side]
    heights = [
        _profile(likelihood, expansion, index) for expansion in likelihood.expand_all(points)
    ]
    split = len(sides[0])
    below = _crossing(top.value, middle, sides[0], heights[:split])
    above = _crossing(top.value, middle, sides[1], heights[split:])
    return -inf if below is None else below, inf if above is None else above


def _at(z: Array, index: int, value: float) -> Array:
    """Return a point (p,) with another value of one coordinate."""
    point: Array = z.copy()
    point[index] = value
    return point


def _profile(likelihood: Likelihood, at: Expansion | None, index: int) -> float:
    """Return the value that a step of all parameters but one is predicted to reach."""
    if at is None:
        return -inf
    J = at.information.copy()
    J[index] = J[:, index] = 0.0
    return at.value + scoring_step(likelihood, at, J, _DAMPING)[1]


def _crossing(top: float, before: float, side: list[float], heights: list[float]) -> float | None:
    """Return where a profile falls by 1.92, by interpolation of the root of its drop."""
    deviation = 0.0
    for z, height in zip(side, heights):
        drop = float(np.sqrt(2.0 * max(top - height, 0.0)))
        if drop >= _END:
            share = (_END - deviation) / (drop - deviation) if np.isfinite(drop) else 0.0
            return before + share * (z - before)
        before, deviation = z, drop
    return None
