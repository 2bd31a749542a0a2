# SPDX-License-Identifier: Apache-2.0
"""How fast recordings are replayed, and how little recording takes, as shares of their time."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import estimator_settings, replay
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.core import Array, LinearSystem, Signal

from .benchmark import Benchmark
from .filters import second
from .linear import parameters

#: States, readings of one message, filter, its arithmetic, rate in Hz, how many times faster than
#: real time it has to be where a step of filterpy's EKF takes 23 us, and the seconds of the
#: recording.
_CASES = (
    ('replay, kf, 4 states at 100 Hz / its time', 4, 2, 'kf', 'compiled', 100.0, 200.0, 120.0),
    ('replay, ukf, 15 states at 200 Hz / its time', 15, 6, 'ukf', 'compiled', 200.0, 300.0, 120.0),
    ('replay in C, ekf, 15 states at 200 Hz / its time', 15, 6, 'ekf', 'c', 200.0, 1000.0, 120.0),
)
#: When the recordings begin, in nanoseconds.
_START = 1_700_000_000_000_000_000


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Give one benchmark a filter and size."""
    with tempfile.TemporaryDirectory(prefix='kalman_ros_') as folder:
        found = []
        for index, (name, n, k, filter, arithmetic, rate, times, seconds) in enumerate(_CASES):
            values = {**parameters(n, k, filter, rate), 'arithmetic': arithmetic}
            path = Path(folder) / str(index)
            record(path, values, seconds)
            ours = partial(_share, path, values, seconds)
            ours()  # imports
            found.append(Benchmark(name, 1.0 / times, ours, second))
        yield found


def _share(path: Path, values: Mapping[str, Any], seconds: float) -> float:
    """Return the processor time of a replay, in seconds for each that was recorded."""
    start = time.process_time()
    replay(path, values)
    return (time.process_time() - start) / seconds


def record(folder: Path, values: Mapping[str, Any], seconds: float) -> None:
    """Write the recording of a linear system with these parameters, without an input."""
    scenario = estimator_settings(values).scenario
    model = scenario.model
    assert isinstance(model, LinearSystem)
    rng, dt = np.random.default_rng(1), 1.0 / scenario.rate
    step, source = model.sampled(dt), scenario.sensors['y']
    x: Array = np.zeros(model.state.size)
    root, noise = np.linalg.cholesky(step.Q), np.sqrt(source.sensor.covariance.diagonal())
    with RecordingWriter(folder) as writer:
        write = _writer(writer, source.signal)
        for index in range(round(seconds * scenario.rate)):
            y = source.sensor.measure(x) + noise * rng.normal(size=noise.size)
            write(_START + round(index * dt * 1e9), y)
            x = step.F @ x + root @ rng.normal(size=x.size)


def _writer(writer: RecordingWriter, signal: Signal) -> Any:
    encode, topic = WireWriter(codec_of(signal)), f'/{signal.topic}'
    writer.add(topic, full_type(signal.type))

    def write(time: int, y: Array) -> None:
        message = encode(time, y)
        data = message if isinstance(message, bytes) else bytes(serialize_message(message))
        writer.write(topic, time, data)

    return write
