# SPDX-License-Identifier: Apache-2.0
"""The estimator as a process: time to start and time to answer, against bare rclpy."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.task import Future

from kalman_ros.codecs.messages import leading_stamp, write_stamp
from kalman_ros.harness.executables import executable
from kalman_ros.harness.isolated_context import IsolatedContext
from kalman_ros.harness.process import NodeProcess
from kalman_ros.nodes.middleware.topics import QUEUE

from . import bare
from .benchmark import Benchmark

#: Readings per measurement; and a break between readings as on a robot, in seconds.
_READINGS, _SPACED = 1000, 300
_BREAK = 0.002
#: What a bare node answers with, which topics it answers, and those that it only takes in.
_TOPICS = (
    'nav_msgs/Odometry', 'velocity=geometry_msgs/TwistWithCovarianceStamped', '-',
    'position=geometry_msgs/PoseWithCovarianceStamped',
    'initialpose=geometry_msgs/PoseWithCovarianceStamped', 'force=geometry_msgs/WrenchStamped',
)  # fmt: skip
#: How much later than a bare node the estimator may be ready, in seconds.
_HEAD_START = 0.4


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks; their processes end afterwards."""
    estimator = [str(executable('estimator'))]
    relay = [sys.executable, bare.__file__, *_TOPICS]
    with Respondent(estimator) as ours, Respondent(relay) as peer:
        yield [
            Benchmark('reading to estimate / bare relay', 1.25, ours.answer, peer.answer),
            Benchmark(
                f'the same, {1e3 * _BREAK:g} ms between readings', 1.4,
                partial(ours.answer, _SPACED, _BREAK), partial(peer.answer, _SPACED, _BREAK),
            ),
            Benchmark(
                f'estimator ready / a bare node and {_HEAD_START} s', 1.0,
                ours.restart, lambda: peer.restart() + _HEAD_START,
            ),
        ]  # fmt: skip


class Respondent:
    """A process that answers each velocity with an estimate.

    Parameters
    ----------
    command
        The program.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command

    def __enter__(self) -> Respondent:
        self._context = IsolatedContext(f'bench_{id(self)}')
        self._folder = tempfile.TemporaryDirectory(prefix='kalman_ros_bench_')
        self._message = TwistWithCovarianceStamped()
        self._message.twist.covariance[:] = np.eye(6).ravel()
        self._publisher = self._context.node.create_publisher(
            TwistWithCovarianceStamped, 'velocity', QUEUE
        )
        self._subscription = self._context.node.create_subscription(
            Odometry, 'estimate', self._came, QUEUE, raw=True
        )
        self._done, self._stamp = Future(), 0
        self._start()
        self._until(lambda: self._answered(0.1))  # until it is connected
        self.answer()  # the first answer takes longer
        return self

    def __exit__(self, *_: Any) -> None:
        self._process.stop()
        self._context.close()
        self._folder.cleanup()

    def _start(self) -> None:
        log = Path(self._folder.name) / 'log'
        self._process = NodeProcess('respondent', self._command, self._context.environment, log)
        self._until(lambda: self._publisher.get_subscription_count() > 0)
        self._until(lambda: self._subscription.get_publisher_count() > 0)

    def _until(self, condition: Any) -> None:
        end = time.monotonic() + 20.0
        while not condition():
            if time.monotonic() > end:
                raise RuntimeError(f'{self._command[0]}: {self._process.last_words()}')
            self._context.spin(0.002)

    def restart(self) -> float:
        """Return the seconds from the start of the process until it is connected."""
        self._process.stop()
        self._until(lambda: self._publisher.get_subscription_count() == 0)
        start = time.perf_counter()
        self._start()
        return time.perf_counter() - start

    def answer(self, readings: int = _READINGS, pause: float = 0.0) -> float:
        """Return the median of the seconds from a message to its answer.

        A ``pause`` of some seconds before each lets caches and clocks of the processor cool down.
        """
        return float(np.median([self._once(pause) for _ in range(readings)]))

    def _once(self, pause: float) -> float:
        time.sleep(pause)
        start = time.perf_counter()
        if not self._answered(5.0):
            raise RuntimeError(f'no estimate: {self._process.last_words()}')
        return time.perf_counter() - start

    def _answered(self, patience: float) -> bool:
        """Publish a velocity, and return whether it is answered within ``patience`` seconds."""
        self._done, self._stamp = Future(), time.time_ns()
        write_stamp(self._message.header.stamp, self._stamp)
        self._publisher.publish(self._message)
        return self._context.spin(patience, self._done)

    def _came(self, data: bytes) -> None:
        # an earlier answer may still arrive
        if leading_stamp(data) == self._stamp and not self._done.done():
            self._done.set_result(None)
