# SPDX-License-Identifier: Apache-2.0
"""The parts of sums of Gaussians in pictures: bands and ellipses, as dark as their weights."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba

from kalman_ros.core import Array, Gaussian
from kalman_ros.estimators.mixture import Mixture

from .ellipse import outline
from .style import ESTIMATE, SIGMAS

#: Opacity of a part that has all the weight, and the least with which one can be seen.
_DARKEST, _PALEST = 0.6, 0.04


class Parts(NamedTuple):
    """The parts of all beliefs that are sums of Gaussians.

    ``step`` (p,) counts times; ``weight`` (p,), ``mean`` (p, n) and ``std`` (p, n) are of parts.
    """

    step: Array
    weight: Array
    mean: Array
    std: Array


def parts_of(result: Any) -> Parts | None:
    """Return the parts of filtered beliefs; None where each is a single Gaussian."""
    record = result.record
    beliefs = [] if result.smoothed else [record.steps[index].belief for index in record.shown]
    sums = [(k, belief) for k, belief in enumerate(beliefs) if isinstance(belief, Mixture)]
    if not sums:
        return None
    whole = [
        (k, w, *part) for k, mixture in sums for w, part in zip(mixture.weights, mixture.parts)
    ]
    steps, weights, means, covariances = zip(*whole)
    variances = np.array(covariances).diagonal(axis1=1, axis2=2)
    return Parts(np.array(steps), np.array(weights), np.array(means), np.sqrt(variances))


def draw_parts(axis: Any, time: Array, parts: Parts, index: int) -> None:
    """Draw the band of each part in a state, from its time (N,) to the next one."""
    last = np.median(np.diff(time)) if len(time) > 1 else 1.0
    start, end = time[parts.step], np.append(time[1:], time[-1] + last)[parts.step]
    band = SIGMAS * parts.std[:, index]
    low, high = parts.mean[:, index] - band, parts.mean[:, index] + band
    corners = np.stack((start, low, end, low, end, high, start, high), axis=1)
    _draw(axis, corners.reshape(-1, 4, 2), parts.weight, 'its parts')


def draw_part_ellipses(
    axis: Any, belief: Gaussian, scale: float, origin: Array, label: str | None = None
) -> None:
    """Draw ellipses of the parts in the first two states, in units of ``scale``."""
    if isinstance(belief, Mixture):
        corners = [
            (origin + outline(part.mean[:2], part.covariance[:2, :2], SIGMAS)) / scale
            for part in belief.parts
        ]
        _draw(axis, corners, belief.weights, label)


def _draw(axis: Any, corners: Any, weights: Array, label: str | None) -> None:
    order = np.argsort(-weights)  # a legend shows the first one
    colours = np.tile(to_rgba(ESTIMATE), (len(weights), 1))
    colours[:, 3] = np.maximum(_DARKEST * weights[order], _PALEST)
    corners = np.asarray(corners)[order]
    axis.add_collection(PolyCollection(corners, facecolors=colours, lw=0, label=label))
    axis.autoscale_view()
