# SPDX-License-Identifier: Apache-2.0
"""How much of a processor recording takes, with nothing lost."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.harness.domain import Domain
from kalman_ros.harness.graph_recorder import GraphRecorder
from kalman_ros.harness.process import isolated

from . import traffic
from .benchmark import Benchmark

_TOPICS, _RATE, _SECONDS = 20, 200.0, 5.0
#: The acceptable share of a processor.
_GOAL = 0.1


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Give the benchmark."""
    name = f'recording {_TOPICS} topics at {_RATE:g} Hz / a processor'
    yield [Benchmark(name, _GOAL, _share, lambda: 1.0)]


def _share() -> float:
    """Return the processor seconds of the recorder for each second; RuntimeError on a loss."""
    domain = Domain()
    arguments = [sys.executable, traffic.__file__, str(_TOPICS), str(_RATE), str(_SECONDS)]
    with tempfile.TemporaryDirectory(prefix='kalman_ros_') as folder:
        writer = RecordingWriter(Path(folder) / 'bag')
        recorder = GraphRecorder(writer, [f'traffic_{k}' for k in range(_TOPICS)], domain.id)
        stop = Event()
        thread = Thread(target=recorder.run, args=(stop, 60.0))
        source = subprocess.Popen(arguments, env=isolated(domain.id))
        start = begun = 0.0
        try:
            thread.start()
            while not recorder.count and source.poll() is None:
                time.sleep(0.01)  # to find the topics takes more than their messages do
            start, begun = time.process_time(), time.monotonic()
            source.wait(60.0)
        finally:
            source.kill()
            stop.set()
            thread.join()
            used, wall = time.process_time() - start, time.monotonic() - begun
            recorder.close()
            writer.close()
            domain.close()
    wanted = round(_TOPICS * _RATE * _SECONDS)
    if writer.count != wanted:
        raise RuntimeError(f'{writer.count} of {wanted} messages were recorded')
    return used / wall
