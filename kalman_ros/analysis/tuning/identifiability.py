# SPDX-License-Identifier: Apache-2.0
"""Which parameters the data determine, how well, and why not the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np

from kalman_ros.core import Array

from .free_parameter import FreeParameter
from .intervals import reach

#: Directions with less than this part of the information of their parameters are not seen.
_NULL = 1e-6
#: A parameter with a larger share in these directions is not determined.
_LOADING = 1e-4
#: The longest interval that says anything: 95 % within a factor of 10; and of a number that is not
#: fitted on a logarithmic scale, in units of its scale.
_WIDEST, _WIDEST_SCALED = log(10.0), 6.0
#: Parameters whose deviation is this many times such an interval are as good as absent.
_ABSENT = 50.0
#: A deviation this many times the one with the others known is due to them.
_TIED = 3.0


@dataclass(frozen=True)
class Determination:
    """How well the data determine each of p parameters, on the scale of the fit.

    Parameters
    ----------
    std
        Standard deviations (p,); NaN where it has no meaning.
    correlation
        Between the errors (p, p); NaN likewise.
    reasons
        Why a parameter is not determined; '' where it is.
    rank
        The number of combinations that the data determine.
    seen
        Which the data depend on at all (p,).
    """

    std: Array
    correlation: Array
    reasons: tuple[str, ...]
    rank: int
    seen: Any

    @property
    def covariance(self) -> Array:
        """Of the errors (p, p); 0 for those that are not determined."""
        known = np.isfinite(self.std)
        std = np.where(known, self.std, 0.0)
        correlation = np.where(np.outer(known, known), self.correlation, 0.0)
        return np.asarray(correlation * np.outer(std, std))


def determination(
    parameters: Sequence[FreeParameter],
    information: Array,
    z: Array,
    power: Array | None = None,
) -> Determination:
    """Return what an information (p, p) at z (p,) determines.

    Noise has variances proportional to exp(power z), with a power (p,) of 0 for other parameters.

    The information in units of each parameter's own is split into its eigenvectors: those with
    nearly no information are combinations that these data do not show (T. Rothenberg,
    Identification in Parametric Models, Econometrica 39(3), 1971).
    """
    p = len(parameters)
    alone = np.sqrt(np.maximum(information.diagonal(), 0.0))
    power = np.zeros(p) if power is None else power
    widest = np.array([_WIDEST if each.positive else _WIDEST_SCALED for each in parameters])
    seen = alone * widest * _ABSENT > 1.0
    reasons = ['' if each else 'these data do not depend on it' for each in seen]
    d = np.where(seen, alone, 1.0)
    C = np.where(np.outer(seen, seen), information / np.outer(d, d), np.eye(p))
    values, vectors = np.linalg.eigh(C)
    null = values < _NULL
    inverse = np.where(null, 0.0, 1.0 / np.where(null, 1.0, values))
    covariance = (vectors * inverse) @ vectors.T / np.outer(d, d)
    std = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    loading = np.sum(np.where(null, vectors**2, 0.0), axis=1)
    for index in np.flatnonzero(seen).tolist():
        if loading[index] > _LOADING:
            others = _partners(parameters, vectors[:, null], index)
            reasons[index] = f'only a combination with {others} shows'
        elif max(reach(float(std[index]), float(power[index]))) > widest[index]:
            reasons[index] = _wide(parameters, covariance, alone, index)
    _at_bounds(parameters, z, reasons)
    known = np.array([not reason for reason in reasons])
    std = np.where(known, std, np.nan)
    correlation = covariance / np.outer(std, std)
    rank = int(np.sum(~null)) - int(np.sum(~seen))
    return Determination(std, correlation, tuple(reasons), rank, seen)


def _partners(parameters: Sequence[FreeParameter], null: Array, index: int) -> str:
    """Return the parameters that a direction without information ties to one of them."""
    direction = null @ null[index]
    direction /= np.abs(direction).max()
    tied = [
        each.name
        for other, each in enumerate(parameters)
        if other != index and abs(direction[other]) > 0.1
    ]
    return ' and '.join(tied) or 'others'


def _wide(parameters: Sequence[FreeParameter], covariance: Array, alone: Array, index: int) -> str:
    """Return why a standard deviation is too wide."""
    std = np.sqrt(covariance.diagonal())
    if std[index] * alone[index] > _TIED:
        correlation = covariance[index] / (std[index] * std)
        correlation[index] = 0.0
        other = int(np.argmax(np.abs(correlation)))
        return (
            f'it can hardly be distinguished from {parameters[other].name} '
            f'(correlation {correlation[other]:+.3f})'
        )
    return 'these data hardly depend on it'


def _at_bounds(parameters: Sequence[FreeParameter], z: Array, reasons: list[str]) -> None:
    """Say where a parameter is at a bound: its interval has no meaning."""
    for index, each in enumerate(parameters):
        low, high = each.limits
        if not reasons[index] and not low + 1e-9 < z[index] < high - 1e-9:
            bound = each.low if z[index] <= low + 1e-9 else each.high
            reasons[index] = f'it is at its bound, {bound:g}'
