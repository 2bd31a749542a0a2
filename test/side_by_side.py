# SPDX-License-Identifier: Apache-2.0
"""Runs the tests in two processes side by side, then those with nodes, and counts them all.

    python test/side_by_side.py [ARGUMENTS OF PYTEST]

What is in real time, and all of test/scenarios, is not disturbed by other tests: it comes last
and by itself. Of the rest each process has every other file (`PARTS` in conftest.py). The output
of one of them is seen as it comes, that of the other after it.

Exit code: that of pytest, of the process that failed if one did; 130 after an interrupt.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

import pytest

#: What runs at the same time, one turn after the other.
TURNS = (('even', 'odd'), ('nodes',))
#: What the closing line always counts, and, by the words of pytest, what it does if there is any.
_ALWAYS = ('passed', 'failed', 'skipped')
_ALSO = {'error': 'errors', 'rerun': 'tried again', 'broken': 'of 3 processes broke off'}
_ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Part:
    """A process of pytest that runs one part of the tests, and writes down how many did what."""

    def __init__(self, name: str, folder: Path, arguments: Sequence[str], seen: bool) -> None:
        self.name, self._counts = name, folder / f'{name}.json'
        self._log = None if seen else folder / f'{name}.log'
        colour = ['--color=yes'] if sys.stdout.isatty() else []
        command = [sys.executable, '-m', 'pytest', *colour, *arguments]
        command += [f'--part={name}', f'--counts={self._counts}']
        output = None if self._log is None else self._log.open('wb')
        # in a session of its own: a Ctrl-C reaches it once, from here
        self.process = subprocess.Popen(command, stdout=output, start_new_session=True)

    def show(self) -> None:
        """Print what it has said, if that was not seen yet."""
        if self._log is not None:
            print(f'\n--- the other part: {self.name} ---', flush=True)
            sys.stdout.buffer.write(self._log.read_bytes())

    def counts(self) -> Counter[str]:
        """Return how many tests did what; a process that broke has not said so."""
        if not self._counts.exists():
            return Counter(broken=1)
        return Counter(json.loads(self._counts.read_text()))


def main(arguments: Sequence[str]) -> int:
    """Run all parts and return the exit code."""
    parts: list[Part] = []
    interrupted = []

    def interrupt(number: int, _: FrameType | None) -> None:
        if not interrupted:
            for part in parts:
                if part.process.poll() is None:
                    part.process.send_signal(signal.SIGINT)
        interrupted.append(number)

    for number in _ENDS:
        signal.signal(number, interrupt)
    codes: list[int] = []
    with tempfile.TemporaryDirectory(prefix='kalman_ros_') as folder:
        for names in TURNS[:1] if '--fast' in arguments else TURNS:
            turn = [
                Part(name, Path(folder), arguments, seen=index == 0)
                for index, name in enumerate(names)
                if not interrupted
            ]
            parts += turn
            codes += [part.process.wait() for part in turn]
            for part in turn:
                part.show()
        total = sum((part.counts() for part in parts), Counter())
    print(f'\nin all: {closing(total)}')
    return 128 + interrupted[0] if interrupted else exit_code(codes)


def closing(counts: Counter[str]) -> str:
    """Return the closing line."""
    words = {**{name: name for name in _ALWAYS}, **_ALSO}
    said = [name for name in words if name in _ALWAYS or counts[name]]
    return ', '.join(f'{counts[name]} {words[name]}' for name in said)


def exit_code(codes: Sequence[int]) -> int:
    """Return the one of the part that failed; a part without any tests did not."""
    ran = [code for code in codes if code != pytest.ExitCode.NO_TESTS_COLLECTED]
    if not ran:
        return int(pytest.ExitCode.NO_TESTS_COLLECTED)
    return next((code if code > 0 else 128 - code for code in ran if code), 0)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
