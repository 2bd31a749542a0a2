# SPDX-License-Identifier: Apache-2.0
"""The claims of the LQG argument, one per file, measured on the real nodes.

A study is a module with a docstring, whose first line is its claim, and a function
``study(size)``: at size 1 the whole study, below 1 a shorter one, for tests.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import MISS, Check
from kalman_ros.control.separation import Expectation
from kalman_ros.core import Array
from kalman_ros.estimators.consistency import chi_square_bounds

#: Names of the studies, in the order of the argument.
STUDIES = (
    'modes',
    'stability',
    'placement',
    'lqr_weights',
    'cross_terms',
    'upright',
    'inversion',
    'reach',
    'decay',
    'observer_noise',
    'kalman_gain',
    'predict_update',
    'separation',
    'cost',
    'bandwidth',
    'margins',
    'phase',
    'doyle',
    'recovery',
    'robust',
    'sampling',
    'sigma_points',
    'one_bearing',
    'slam',
    'spikes',
    'tracking',
    'constraints',
)


@dataclass(frozen=True)
class Findings:
    """The results of a study.

    Parameters
    ----------
    checks
        Comparisons of measured and predicted numbers.
    draw
        Function that draws the picture to a path.
    data
        Further contents of ``summary.json``.
    """

    checks: Sequence[Check]
    draw: Callable[[Any], None]
    data: Mapping[str, Any] = field(default_factory=dict)


def close(name: str, unit: str, expected: float, measured: float, tolerance: float) -> Check:
    """Compare a number with a prediction that holds within ``tolerance``."""
    bounds = expected - tolerance, expected + tolerance
    return Check.within(name, unit, expected, measured, *bounds)


def between(name: str, unit: str, low: float, measured: float, high: float) -> Check:
    """Compare a number with bounds, without a prediction."""
    return Check.within(name, unit, np.nan, measured, low, high)


def largest(difference: Array) -> float:
    """Return the largest magnitude of a difference."""
    return float(np.abs(difference).max())


def mean_square(
    name: str,
    unit: str,
    expected: Expectation,
    measured: float,
    miss: float = MISS,
    *,
    root: bool = False,
) -> Check:
    """Compare a mean square, or its root, with its scatter over runs."""
    low, high = chi_square_bounds(expected.mean, expected.std**2, miss)
    numbers = np.array([expected.mean, measured, low, high])
    return Check.within(name, unit, *(np.sqrt(numbers) if root else numbers).tolist())
