# SPDX-License-Identifier: Apache-2.0
"""How long the doctor takes: a minute of a robot of 15 states, with a wrong scale."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from kalman_ros.analysis.diagnosis.diagnose import diagnose

from ..strangers.injected.recordings import recorded
from .benchmark import Benchmark
from .filters import second

#: Processor time that it may take.
_MOST = 10.0
_SECONDS, _SCALE = 60.0, 1.05


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmark, of processor time."""
    what = 'doctor, a minute of robot_3d, 15 states / 435,000 EKF steps of filterpy'
    robot = recorded('robot_3d', None, _SECONDS, 3)
    wrong = robot.with_values('odometry', _SCALE * robot.sensors['odometry'].value)

    def ours() -> float:
        start = time.process_time()
        first = diagnose(wrong).findings[0]
        assert (first.kind, first.subject) == ('scale', 'odometry')
        return time.process_time() - start

    ours()  # what is compiled is there from then on
    yield [Benchmark(what, 1.0, ours, lambda: _MOST * second())]
