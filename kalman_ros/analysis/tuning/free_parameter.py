# SPDX-License-Identifier: Apache-2.0
"""A parameter that is fitted, and the scale on which it is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, isfinite, log

#: Step of finite differences, on the scale of the fit.
STEP = 1e-4
#: Longest delay of a sensor that a fit considers, and the spacing of those that are compared
#: before it, in seconds.
_LONGEST_DELAY, _SPACING = 1.0, 0.05


@dataclass(frozen=True)
class FreeParameter:
    """A parameter to fit.

    The fit moves z: the logarithm of a positive value, or a value in units of ``scale``.

    Parameters
    ----------
    name
        Name of the parameter, such as ``position.noise``.
    start
        Value at which the fit starts.
    low, high
        Bounds of the value.
    positive
        Whether the value is fitted on a logarithmic scale.
    scale
        Typical size of changes of the value, if it is not ``positive``.
    unit
        Unit of the value.
    prior
        Mean and standard deviation of the prior distribution. A positive value is log-normal, with
        the mean as its median, and the standard deviation as its relative deviation times the
        median.
    scan
        Spacing of the values that are compared before the fit, for a likelihood with several
        maxima; 0 if it has one.

    Raises
    ------
    ValueError
        If the bounds exclude the start, or if a logarithm is not defined.
    """

    name: str
    start: float
    low: float = -inf
    high: float = inf
    positive: bool = False
    scale: float = 1.0
    unit: str = ''
    prior: tuple[float, float] | None = None
    scan: float = 0.0

    def __post_init__(self) -> None:
        if not isfinite(self.start):
            raise ValueError(f'{self.name}: expected a finite start, got {self.start:g}')
        if self.positive and self.start <= 0.0:
            raise ValueError(
                f'{self.name}: expected a start above 0, for it is fitted on a logarithmic '
                f'scale, got {self.start:g}'
            )
        if not self.low < self.high:
            raise ValueError(
                f'{self.name}: expected bounds LOW < HIGH, got {self.low:g} and {self.high:g}'
            )
        if not self.low <= self.start <= self.high:
            raise ValueError(
                f'{self.name}: the bounds {self.low:g} to {self.high:g} exclude the start, '
                f'{self.start:g}'
            )
        if self.prior is not None:
            mean, std = self.prior
            if not (isfinite(mean) and 0.0 < std < inf) or (self.positive and mean <= 0.0):
                raise ValueError(
                    f'{self.name}: expected a prior of a mean and a standard deviation above 0, '
                    f'got {mean:g} and {std:g}'
                )

    @property
    def is_zero(self) -> bool:
        """Whether it is zero and cannot be negative, so that no scale of it can be fitted."""
        return self.low >= 0.0 and not self.positive

    def scaled(self, value: float) -> float:
        """Return the coordinate z of a value."""
        if self.positive:
            return log(value) if value > 0.0 else -inf
        return value / self.scale

    def value(self, z: float) -> float:
        """Return the value at the coordinate z, limited to the bounds."""
        value = exp(min(z, 700.0)) if self.positive else z * self.scale
        return min(max(value, self.low), self.high)

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of z, with room for finite differences of the likelihood."""
        room = 2.0 * STEP
        low, high = self.scaled(self.low), self.scaled(self.high)
        return low + room, high - room

    @property
    def prior_scaled(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the prior of z; None without a prior."""
        if self.prior is None:
            return None
        mean, std = self.prior
        if self.positive:
            return log(mean), std / mean
        return mean / self.scale, std / self.scale


def delay_parameter(sensor: str, start: float, scale: float) -> FreeParameter:
    """Return the delay in seconds of a sensor as a parameter."""
    low, high = min(-_LONGEST_DELAY, start), max(_LONGEST_DELAY, start)
    return FreeParameter(f'{sensor}.delay', start, low, high, scale=scale, unit='s', scan=_SPACING)
