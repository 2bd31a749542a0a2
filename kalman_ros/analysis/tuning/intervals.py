# SPDX-License-Identifier: Apache-2.0
"""Widths of 95 % intervals on the scale of the fit."""

from __future__ import annotations

from math import inf, log

from scipy.special import stdtrit

from kalman_ros.estimators.consistency import chi_square_gate

#: The probabilities below the ends of a 95 % interval.
_LOW, _HIGH = 0.025, 0.975
#: With this number of degrees of freedom, Student's distribution is the normal distribution.
_MANY = 1e9


def reach(std: float, power: float = 0.0, freedom: float = inf) -> tuple[float, float]:
    """Return the widths of the interval of a parameter below and above its value z.

    Noise with variances proportional to exp(power z) has the interval of a variance: the ratio of
    an estimate with f degrees of freedom to the variance is distributed as chi-square divided by
    f, and its information on the logarithm is f / 2 (G. Casella and R. Berger, Statistical
    Inference, 2002, section 9.2). Any other parameter has Student's distribution with ``freedom``
    degrees of freedom.
    """
    if not power:
        half_width = float(stdtrit(min(freedom, _MANY), _HIGH)) * std
        return half_width, half_width
    f = 2.0 / (power * std) ** 2
    low, high = (chi_square_gate(share, f) / f for share in (_LOW, _HIGH))
    if not low:  # of less than a reading, any noise is likely
        return inf, inf
    below, above = log(high) / abs(power), -log(low) / abs(power)
    return (below, above) if power > 0.0 else (above, below)
