# SPDX-License-Identifier: Apache-2.0
"""What `bench` measures; each group of benchmarks is a module with a context that gives them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

#: Measures once and returns seconds per unit of work.
Contestant = Callable[[], float]


@dataclass(frozen=True)
class Benchmark:
    """Two who do the same work, and the largest ratio of ours to theirs that is good."""

    name: str
    goal: float
    ours: Contestant
    peer: Contestant
