# SPDX-License-Identifier: Apache-2.0
"""The claims of the LQG argument, one a file, each measured on the real nodes.

A study is a module with a docstring, whose first line is its claim, and a function
``study(size)``: at size 1 the whole study, at less a shorter one, for tests.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check

#: In the order of the argument.
STUDIES = (
    'stability',
    'placement',
    'lqr_weights',
    'upright',
    'inversion',
    'observer_noise',
    'kalman_gain',
    'separation',
    'cost',
    'bandwidth',
    'margins',
    'doyle',
    'recovery',
)


@dataclass(frozen=True)
class Findings:
    """What a study measured.

    Parameters
    ----------
    checks
        Measured numbers beside predicted ones.
    draw
        Draws the picture to a path.
    data
        What else goes into ``summary.json``.
    """

    checks: Sequence[Check]
    draw: Callable[[Any], None]
    data: Mapping[str, Any] = field(default_factory=dict)


def close(name: str, unit: str, expected: float, measured: float, tolerance: float) -> Check:
    """Return the comparison of a number with a prediction that holds within ``tolerance``."""
    low, high = expected - tolerance, expected + tolerance
    return Check(name, unit, expected, measured, low, high, bool(low <= measured <= high))


def between(name: str, unit: str, low: float, measured: float, high: float) -> Check:
    """Return the comparison of a number with bounds, of which theory says no more."""
    return Check(name, unit, np.nan, measured, low, high, bool(low <= measured <= high))
