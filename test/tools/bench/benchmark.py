# SPDX-License-Identifier: Apache-2.0
"""A benchmark of `bench`; each group is a module with a context that yields them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

#: Measures once and returns seconds per unit of work.
Timing = Callable[[], float]


@dataclass(frozen=True)
class Benchmark:
    """Two implementations of the same work, and the largest acceptable ratio of their times."""

    name: str
    goal: float
    ours: Timing
    peer: Timing
