# SPDX-License-Identifier: Apache-2.0
"""A step of the whole loop, with monitor and recorder, against bare rclpy."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from kalman_ros.harness import Run

from .benchmark import Benchmark
from .ring import Ring


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmark, with the nodes of both running, one idle at a time."""
    with Run() as run, Ring() as ring:
        run.advance(1.0)
        ring.rounds(100)

        def ours() -> float:
            start = time.perf_counter()
            run.advance(5.0)
            # the harness's final wait is not part of a step
            return (time.perf_counter() - start - run.drained) / (5.0 * run.scenario.rate)

        # 60 s at 100 Hz under 8 s, where the ring alone would take 3.5 s
        goal = 8.0 / 3.5
        yield [Benchmark('lockstep step / bare rclpy ring', goal, ours, lambda: ring.rounds(500))]
