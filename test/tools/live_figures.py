# SPDX-License-Identifier: Apache-2.0
"""Figures of the live page on this machine: pictures, processor time, latencies and memory.

``python test/tools/live_figures.py [--minutes N] [SCENARIO]``, in an environment in which the
package is installed, with Chromium for the pictures. Processor time is that of the process of the
page, without the nodes, as a share of one core.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from kalman_ros.harness import executables

#: Duration in seconds of a measurement of processor time, and number of moves of a slider.
_SECONDS, _MOVES = 15.0, 40
#: Weight that is moved.
_KEY = 'controller/input_cost/0'
#: Counts the drawings of the system.
_COUNT = """(() => { window.drawings = 0;
    const pen = CanvasRenderingContext2D.prototype, clear = pen.clearRect;
    pen.clearRect = function (...box) {
        if (this.canvas.id === 'system') window.drawings++;
        return clear.apply(this, box);
    }; })()"""


class Tab:
    """A client of the page without a browser."""

    def __init__(self, port: int) -> None:
        self.socket: ClientConnection = connect(
            f'ws://127.0.0.1:{port}/socket', origin=f'http://127.0.0.1:{port}',
            max_size=None, max_queue=None, proxy=None,
        )  # type: ignore[arg-type]  # fmt: skip
        self._count = 0
        self.theory = self.values = -1

    def send(self, **command: Any) -> None:
        """Send a command."""
        self._count += 1
        self.socket.send(json.dumps({**command, 'n': self._count}))

    def read(self, seconds: float = 20.0) -> list[dict[str, Any]]:
        """Return the frames of the next message, and notice versions."""
        message = json.loads(self.socket.recv(timeout=seconds))
        kind = message['kind']
        if kind in ('theory', 'values'):
            setattr(self, kind, message.get('version', -1))
        return list(message.get('frames', ()))

    def read_for(self, seconds: float) -> None:
        """Read whatever comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.read()

    def move(self, value: float) -> tuple[float, float]:
        """Move the slider; return the milliseconds to the new input and to the new poles."""
        start, before, latency = time.monotonic(), self.values, 0.0
        self.send(do='set', key=_KEY, value=value)
        while not latency or self.values == before or self.theory < self.values:
            for frame in self.read():
                latency = frame.get('latency', {}).get('ms', latency)
        return latency, 1e3 * (time.monotonic() - start)


def processor_time(process: int) -> float:
    """Return the processor time in seconds that a process has used."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def resident(process: int) -> float:
    """Return the memory of a process in MB."""
    pages = int(Path(f'/proc/{process}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def percentile(values: list[float], share: float = 0.95) -> float:
    """Return a percentile, as a value that was measured."""
    return sorted(values)[math.ceil(share * len(values)) - 1]


def drawings_per_second(port: int, process: int) -> tuple[float, float]:
    """Return the drawings of the system per second in a browser, and the share of the page."""
    path = Path(__file__).parents[2] / 'docs' / 'chromium.py'
    spec = importlib.util.spec_from_file_location('chromium', path)
    assert spec is not None and spec.loader is not None
    chromium = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(chromium)
    with chromium.Chromium(1280, 800) as browser:
        browser.open(f'http://127.0.0.1:{port}/')
        browser.until('Number.parseFloat(document.querySelector("#clock")?.textContent) > 1')
        time.sleep(3.0)
        browser.run(_COUNT)
        start, used = time.monotonic(), processor_time(process)
        time.sleep(_SECONDS)
        elapsed = time.monotonic() - start
        return browser.run('window.drawings') / elapsed, (processor_time(process) - used) / elapsed


def measure(port: int, process: int, minutes: float) -> None:
    """Measure a running page, and print its figures."""

    def report(text: str) -> None:
        print(f'{text}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors', flush=True)

    def share(run: Any) -> float:
        start, used = time.monotonic(), processor_time(process)
        run(_SECONDS)
        return 100.0 * (processor_time(process) - used) / (time.monotonic() - start)

    time.sleep(5.0)
    report(f'server without a client: {share(time.sleep):.1f} % of a core')
    tab = Tab(port)
    tab.read_for(3.0)
    report(f'server with one client: {share(tab.read_for):.1f} % of a core')
    moves = [tab.move(1.0 + 0.05 * k) for k in range(_MOVES)]
    inputs, poles = ([move[k] for move in moves] for k in (0, 1))
    report(f'slider to the input by the new gain: 95 % within {percentile(inputs):.0f} ms')
    report(f'slider to the new poles: 95 % within {percentile(poles):.0f} ms')
    tab.send(do='ghost', filter='')
    tab.read_for(1.0)
    with_ghost = share(lambda seconds: tab.read_for(min(seconds, 8.0)))
    report(f'server with one client and a ghost: {with_ghost:.1f} % of a core')
    tab.send(do='ghost', shown=False)
    pictures, used = drawings_per_second(port, process)
    report(f'in a browser: {pictures:.1f} pictures/s, server {100.0 * used:.1f} % of a core')
    before = resident(process)
    tab.read_for(60.0 * minutes)
    report(f'memory after {minutes:g} min: {resident(process):.1f} MB, {before:.1f} MB before')


def main() -> None:
    """Start a page, measure it, and end it."""
    parser = argparse.ArgumentParser(description='Measure the live page on this machine.')
    parser.add_argument('scenario', nargs='?', default='cart_pole')
    parser.add_argument('--minutes', type=float, default=10.0, help='for the growth of memory')
    options = parser.parse_args()
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    program = str(executables.executable('live'))
    server = subprocess.Popen(
        [program, '--no-browser', '--port', str(port), options.scenario],
        stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert server.stdout is not None
        print(server.stdout.readline().strip(), flush=True)
        measure(port, server.pid, options.minutes)
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.wait(20)


if __name__ == '__main__':
    main()
