# SPDX-License-Identifier: Apache-2.0
"""Parameters that the data determine, their accuracy, and why the others are undetermined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, log
from typing import Any

import numpy as np

from kalman_ros.core import Array

from .free_parameter import FreeParameter
from .intervals import reach

#: Directions with less than this share of the information of their parameters are unobservable.
_NULL = 1e-6
#: A parameter with a larger share in these directions is not determined.
_LOADING = 1e-4
#: The widest 95 % interval of a determined parameter: a factor of 10 on a logarithmic scale, and
#: otherwise in units of the scale, or as a share of the range between its bounds.
_WIDEST, _WIDEST_SCALED, _NARROWS = log(10.0), 6.0, 0.05
#: The data do not depend on a parameter whose deviation is this multiple of such an interval.
_ABSENT = 50.0
#: A deviation is due to other parameters if it is this multiple of the one with those known.
_TIED = 3.0

#: Reason of a parameter with a wide interval, and of one with an end on one side.
UNCERTAIN = 'these data hardly depend on it'
ONE_SIDED = 'these data limit it on one side only'


@dataclass(frozen=True)
class Determination:
    """The accuracy with which the data determine p parameters, on the scale of the fit.

    Parameters
    ----------
    std
        Standard deviations (p,); NaN for a parameter that is not determined.
    correlation
        Correlations of the errors (p, p); NaN for a parameter that is not determined.
    reasons
        Reason for which each parameter is not determined; '' if it is.
    rank
        Number of combinations of parameters that the data determine.
    seen
        Whether the data depend on each parameter at all (p,).
    combined
        Whether each parameter shows only in combination with others (p,).
    widest
        Width on either side of the widest interval of a parameter that is determined by its
        information alone (p,).
    """

    std: Array
    correlation: Array
    reasons: tuple[str, ...]
    rank: int
    seen: Any
    combined: Any
    widest: Array

    @property
    def covariance(self) -> Array:
        """Covariance of the errors (p, p); 0 for parameters that are not determined."""
        known = np.isfinite(self.std)
        std = np.where(known, self.std, 0.0)
        correlation = np.where(np.outer(known, known), self.correlation, 0.0)
        return np.asarray(correlation * np.outer(std, std))


def determination(
    parameters: Sequence[FreeParameter], information: Array, z: Array, power: Array | None = None
) -> Determination:
    """Return the parameters that an information matrix (p, p) at z (p,) determines.

    Noise has variances proportional to exp(power z), with a power (p,) of 0 for other parameters.

    The information is normalised to a unit diagonal and decomposed into eigenvectors. Eigenvectors
    with nearly no information are combinations that these data do not show (T. Rothenberg,
    Identification in Parametric Models, Econometrica 39(3), 1971).
    """
    p = len(parameters)
    alone = np.sqrt(np.maximum(information.diagonal(), 0.0))
    power = np.zeros(p) if power is None else power
    widest = np.array([_widest(free) for free in parameters])
    seen = alone * widest * _ABSENT > 1.0
    reasons = ['' if flag else 'these data do not depend on it' for flag in seen]
    d = np.where(seen, alone, 1.0)
    C = np.where(np.outer(seen, seen), information / np.outer(d, d), np.eye(p))
    values, vectors = np.linalg.eigh(C)
    null = values < _NULL
    inverse = np.where(null, 0.0, 1.0 / np.where(null, 1.0, values))
    covariance = (vectors * inverse) @ vectors.T / np.outer(d, d)
    std = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    loading = np.sum(np.where(null, vectors**2, 0.0), axis=1)
    combined = seen & (loading > _LOADING)
    for index in np.flatnonzero(seen).tolist():
        if combined[index]:
            others = _tied_parameters(parameters, vectors[:, null], index)
            reasons[index] = f'only a combination with {others} shows'
        elif max(reach(float(std[index]), float(power[index]))) > widest[index]:
            reasons[index] = _reason_of_width(parameters, covariance, alone, index)
    _add_bound_reasons(parameters, z, reasons)
    known = np.array([not reason for reason in reasons])
    std = np.where(known, std, np.nan)
    correlation = covariance / np.outer(std, std)
    rank = int(np.sum(~null)) - int(np.sum(~seen))
    return Determination(std, correlation, tuple(reasons), rank, seen, combined, widest)


def _widest(free: FreeParameter) -> float:
    """Return half the widest interval of a parameter that counts as determined."""
    if free.positive:
        return _WIDEST
    bounds = _NARROWS * (free.high - free.low) / free.scale
    return max(_WIDEST_SCALED, bounds) if isfinite(bounds) else _WIDEST_SCALED


def _tied_parameters(parameters: Sequence[FreeParameter], null: Array, index: int) -> str:
    """Return the parameters that directions without information tie to one parameter."""
    direction = null @ null[index]
    direction /= np.abs(direction).max()
    tied = [
        free.name
        for other, free in enumerate(parameters)
        if other != index and abs(direction[other]) > 0.1
    ]
    return ' and '.join(tied) or 'others'


def _reason_of_width(
    parameters: Sequence[FreeParameter], covariance: Array, alone: Array, index: int
) -> str:
    """Return the reason for which a standard deviation is too large."""
    std = np.sqrt(covariance.diagonal())
    if std[index] * alone[index] > _TIED:
        correlation = covariance[index] / (std[index] * std)
        correlation[index] = 0.0
        other = int(np.argmax(np.abs(correlation)))
        return (
            f'it can hardly be distinguished from {parameters[other].name} '
            f'(correlation {correlation[other]:+.3f})'
        )
    return UNCERTAIN


def _add_bound_reasons(parameters: Sequence[FreeParameter], z: Array, reasons: list[str]) -> None:
    """Add a reason for each parameter at a bound, where its interval has no meaning."""
    for index, free in enumerate(parameters):
        low, high = free.limits
        if not reasons[index] and not low + 1e-9 < z[index] < high - 1e-9:
            bound = free.low if z[index] <= low + 1e-9 else free.high
            reasons[index] = f'it is at its bound, {bound:g}'
