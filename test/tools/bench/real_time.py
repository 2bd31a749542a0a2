# SPDX-License-Identifier: Apache-2.0
"""The estimator at the rates of a robot: its processor time, and its answers on a busy machine."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros import scenario
from kalman_ros.codecs.messages import leading_stamp, message_type
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.harness.executables import executable
from kalman_ros.harness.isolated_context import IsolatedContext
from kalman_ros.harness.process import NodeProcess
from kalman_ros.nodes.middleware.topics import QUEUE

from . import bare as bare_node
from .benchmark import Benchmark

#: Seconds of messages per measurement.
_SECONDS = 5.0
#: A process that keeps a core busy, and ends on its own if the bench is killed.
_BUSY = f'from time import monotonic as t; end = t() + {6.0 * _SECONDS}\nwhile t() < end: pass'
#: What is asked of ``robot_3d``: the share of a core, and the 99th percentile in seconds.
_SHARE, _LATE = 0.25, 0.003


class Load(NamedTuple):
    """What a node receives: a scenario, its parameters, and the rate of each topic in Hz."""

    scenario: str
    parameters: dict[str, Any]
    rates: dict[str, float]


_ROBOT = Load(
    'robot_3d',
    {'rate': 200.0, 'imu.rate': 200.0, 'sensors': ['odometry', 'imu']},
    {'imu': 200.0, 'odometry': 50.0},
)
_IN_C = _ROBOT._replace(parameters={**_ROBOT.parameters, 'arithmetic': 'c'})
_DEFAULT = Load('mass_spring_damper_2d', {}, {'velocity': 100.0, 'position': 20.0, '': 100.0})


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks; their processes end afterwards."""
    with ExitStack() as stack:
        ours, peer = (stack.enter_context(Node(_DEFAULT, bare=bare)) for bare in (False, True))
        robot, relay = (stack.enter_context(Node(_ROBOT, bare=bare)) for bare in (False, True))
        whole = stack.enter_context(Node(_IN_C, bare=False))
        yield [
            Benchmark(
                'processor time of the default scenario at 100 Hz / bare relay', 1.6,
                ours.busy, peer.busy,
            ),
            Benchmark(
                'robot_3d, IMU at 200 Hz and odometry at 50 Hz / a quarter of a core', 1.0,
                robot.busy, lambda: _SHARE,
            ),
            Benchmark('its processor time / bare relay', 1.8, robot.busy, relay.busy),
            Benchmark(
                'the same with arithmetic: c / bare relay', 1.7, whole.busy, relay.busy
            ),
            Benchmark(
                'its 99th percentile from reading to estimate, half of the cores busy / 3 ms', 1.0,
                robot.late, lambda: _LATE,
            ),
            Benchmark('the same / bare relay', 3.0, robot.late, relay.late),
        ]  # fmt: skip


class Node:
    """An estimator, or a bare relay of the same messages, that receives them at their rates.

    Parameters
    ----------
    load
        What it receives.
    bare
        Whether it is the relay.
    """

    def __init__(self, load: Load, *, bare: bool) -> None:
        self._load, self._bare = load, bare
        self._built = scenario.build({'model': load.scenario, **load.parameters})

    def __enter__(self) -> Node:
        built = self._built
        self._context = IsolatedContext(f'bench_{id(self)}')
        self._folder = tempfile.TemporaryDirectory(prefix='kalman_ros_real_time_')
        node = self._context.node
        x, u = built.initial_belief.mean, built.model.equilibrium.input
        self._streams: list[tuple[float, Any, WireWriter, Any, Any]] = []
        for name, rate in self._load.rates.items():
            sensor = built.sensors[name].sensor if name else None
            signal = built.sensors[name].signal if name else built.input
            write = WireWriter(codec_of(signal))
            publisher = node.create_publisher(write.message_type, signal.topic, QUEUE)
            values = u if sensor is None else sensor.measure(x)
            R = None if sensor is None else sensor.covariance
            self._streams.append((rate, publisher, write, values, R))
        kind = message_type(built.state.type)
        self._subscription = node.create_subscription(
            kind, built.state.topic, self._came, QUEUE, raw=True
        )
        self._sent: dict[int, float] = {}
        self._delays: list[float] = []
        log = Path(self._folder.name) / 'log'
        self._process = NodeProcess('node', self._command(), self._context.environment, log)
        end = time.monotonic() + 30.0
        while not self._connected():
            if time.monotonic() > end:
                raise RuntimeError(f'{self._load.scenario}: {self._process.last_words()}')
            self._context.spin(0.01)
        self._pass(1.0)  # the first messages take longer
        return self

    def __exit__(self, *_: Any) -> None:
        self._process.stop()
        self._context.close()
        self._folder.cleanup()

    def _command(self) -> list[str]:
        built, load = self._built, self._load
        if self._bare:
            read = [name for name in load.rates if name]
            signals = [built.sensors[name].signal for name in read]
            topics = [f'{signal.topic}={signal.type}' for signal in signals]
            if '' in load.rates:
                topics += ['-', f'{built.input.topic}={built.input.type}']
            return [sys.executable, bare_node.__file__, built.state.type, *topics]
        given = {'model': load.scenario, **load.parameters}
        pairs = (f'{name}:={_text(value)}' for name, value in given.items())
        arguments = [argument for pair in pairs for argument in ('-p', pair)]
        return [str(executable('estimator')), '--ros-args', *arguments]

    def _connected(self) -> bool:
        heard = all(each[1].get_subscription_count() for each in self._streams)
        return heard and self._subscription.get_publisher_count() > 0

    def busy(self) -> float:
        """Return the processor time of its threads per second of messages, in s."""
        before = _processor_time(self._process.pid)
        passed = self._pass(_SECONDS)
        return (_processor_time(self._process.pid) - before) / passed

    def late(self) -> float:
        """Return the 99th percentile from a reading to its estimate, in s, on a busy machine."""
        count = max(1, (os.cpu_count() or 2) // 2)
        busy = [subprocess.Popen([sys.executable, '-c', _BUSY]) for _ in range(count)]
        try:
            self._pass(0.5)  # the first reading bridges the time that has passed since the last
            self._pass(_SECONDS)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        lost = [np.inf] * len(self._sent)
        return float(np.quantile([*self._delays, *lost], 0.99, method='higher'))

    def _pass(self, seconds: float) -> float:
        """Send messages for some seconds; return how long that took."""
        self._sent.clear()
        self._delays.clear()
        # no two messages at once: a node may answer those with one estimate
        due = sorted(
            ((k + 0.2 * number) / rate, number)
            for number, (rate, *_) in enumerate(self._streams)
            for k in range(round(seconds * rate))
        )
        start = time.monotonic()
        for at, number in due:
            self._context.spin(max(0.0, start + at - time.monotonic()))
            _, publisher, write, values, R = self._streams[number]
            stamp = time.time_ns()
            message = write(stamp, values, R)
            if R is not None:  # inputs are not answered
                self._sent[stamp] = time.perf_counter()
            publisher.publish(message)
        passed = time.monotonic() - start
        self._context.spin(0.1)
        if not self._delays:
            raise RuntimeError(f'{self._load.scenario}: no estimate: {self._process.last_words()}')
        return passed

    def _came(self, data: bytes) -> None:
        # readings that waited together have one estimate, with the stamp of the newest
        now, stamp = time.perf_counter(), leading_stamp(data)
        for each in [each for each in self._sent if each <= stamp]:
            self._delays.append(now - self._sent.pop(each))


def _text(value: Any) -> str:
    return f'[{", ".join(value)}]' if isinstance(value, list) else str(value)


def _processor_time(pid: int) -> float:
    """Return the seconds for which the threads of a process have run, on Linux."""
    total = 0
    for thread in Path(f'/proc/{pid}/task').iterdir():
        with suppress(FileNotFoundError):  # a thread may end meanwhile
            total += int((thread / 'schedstat').read_text().split()[0])
    return total * 1e-9
