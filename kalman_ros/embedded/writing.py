# SPDX-License-Identifier: Apache-2.0
"""A loop written as a folder of C, and built there where there is a compiler."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kalman_ros.compiled import is_available
from kalman_ros.compiled.library import compiler

from .loop import Loop
from .vectors import Call, recorded, text

#: Rounding of a number in single precision, relative to it; the share of a standard deviation
#: that it may reach.
_SINGLE, _COARSE = 2.0**-24, 0.1

#: Test vectors are of a run of this many steps.
STEPS = 400
#: A compiler or a check that takes longer, in seconds, is given up.
_PATIENCE = 300.0


@dataclass(frozen=True)
class Written:
    """A loop that was written as C.

    Parameters
    ----------
    folder, name
        Where, and the beginning of all public names.
    files
        Their names.
    calls
        Number of recorded calls.
    precision
        float64 or float32.
    """

    folder: Path
    name: str
    files: Sequence[str]
    calls: int
    precision: str = 'float64'

    def discard(self) -> None:
        """Remove the files, what was made of them, and the folder if nothing else is in it."""
        made = [f'{self.name}.o', f'lib{self.name}.a', 'check.out']
        for file in [*self.files, *made, *(report.name for report in self.folder.glob('*.su'))]:
            (self.folder / file).unlink(missing_ok=True)
        if self.folder.is_dir() and not any(self.folder.iterdir()):
            self.folder.rmdir()


@dataclass(frozen=True)
class Built:
    """Sizes and results of a loop that was built and checked on this machine.

    Parameters
    ----------
    command
        The compiler.
    flash
        Bytes of code and constants.
    ram
        Bytes of the struct.
    stack
        A bound of the stack in bytes; None where the compiler does not say.
    microseconds
        Time of a step in which every sensor reads.
    operations
        Additions, multiplications, divisions and functions of such a step; None without a compiler
        of C++, which counts them.
    difference
        The largest from what Python computed.
    """

    command: str
    flash: int
    ram: int
    stack: int | None
    microseconds: float
    operations: int | None
    difference: float

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Names and values of all figures."""
        stack = [] if self.stack is None else [('stack, at most', f'{self.stack} bytes')]
        count = [] if self.operations is None else [('its operations', str(self.operations))]
        return [
            ('flash: code and constants', f'{self.flash} bytes'),
            ('RAM: the struct', f'{self.ram} bytes'),
            *stack,
            ('a step in which every sensor reads', f'{self.microseconds:.2f} us'),
            *count,
            ('largest difference from Python', f'{self.difference:.1e}'),
        ]


def write(
    loop: Loop,
    folder: Path,
    name: str,
    precision: str = 'float64',
    source: str = 'a scenario',
    *,
    steps: int = STEPS,
) -> Written:
    """Write a loop into a new folder.

    Parameters
    ----------
    loop
        What is exported.
    folder
        Where; made if it is not there.
    name
        The beginning of all public names.
    precision
        float64 or float32.
    source
        Where the loop is from, for the header.
    steps
        Of the run that the test vectors are recorded of, beside those of a motion.

    Raises
    ------
    ValueError
        If CasADi is not installed, the folder is not empty, C does not accept a name, or a
        function cannot be traced.
    """
    if not is_available():
        raise ValueError('it takes CasADi, which writes formulas: pip install casadi')
    from .source import loop_files  # CasADi is slow to load

    if not 1 <= steps <= 1_000_000:
        raise ValueError(f'steps: expected 1 to 1000000, got {steps}')
    files = loop_files(loop, name, precision, source)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"out: '{folder}' is there already: name another folder")
    motion = None if loop.law is None else loop.law.motion
    calls = [*recorded(loop, steps + (0 if motion is None else len(motion.states)))]
    if precision == 'float32':
        _check_resolution(loop, calls)
    files['vectors.txt'] = text(loop, calls)
    written = Written(folder, name, [*files], len(calls), precision)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, contents in files.items():
            (folder / file).write_text(contents)
    except OSError as error:
        with suppress(OSError):
            written.discard()
        raise ValueError(f'out: cannot write to {folder}: {error.strerror}') from None
    return written


def _check_resolution(loop: Loop, calls: Sequence[Call]) -> None:
    """Raise ValueError where single precision is coarse beside the deviation of an estimate."""
    largest = np.max([np.abs(call.mean) for call in calls], axis=0)
    stds = np.array([call.std for call in calls])
    least = np.min(np.where(stds > 0.0, stds, np.inf), axis=0)
    coarse = _SINGLE * largest
    for name, step, value, std in zip(loop.space.names, coarse, largest, least):
        if step > _COARSE * std:
            raise ValueError(
                f'precision: float32 resolves {name} = {value:.3g} to {step:.1g}, with a standard '
                f'deviation of {std:.2g}: take float64, or a place nearer to zero'
            )


def build(written: Written) -> Built | None:
    """Compile and check what was written; None where `missing` names a tool.

    Raises
    ------
    ValueError
        If the compiler fails, or C does not compute what Python did; then nothing stays there.
    """
    if missing():
        return None
    try:
        return _built(written)
    except ValueError as error:
        written.discard()
        if written.precision == 'float32' and 'check:' in str(error):
            raise ValueError(
                f'precision: float32 is too coarse for this loop, take float64: {error}'
            ) from None
        raise


def _built(written: Written) -> Built:
    command = compiler()
    here, name = written.folder, written.name
    flags = '-O2 -fstack-usage' if 'clang' not in command[0] else '-O2'
    out = _run(here, ['make', f'CC={" ".join(command)}', f'CFLAGS={flags}', 'check'])
    said = re.search(r'the struct has (\d+) bytes; .* takes (\S+) us', out)
    assert said is not None, out
    text_, data, *_ = _run(here, ['size', f'{name}.o']).splitlines()[1].split()
    difference = out.rpartition('largest difference ')[2].partition(' ')[0]
    usage = here / f'{name}.su'
    stack = _frames(usage) if usage.exists() else None
    for report in here.glob('*.su'):
        report.unlink()
    _run(here, ['make', 'clean'])
    return Built(
        ' '.join(command),
        int(text_) + int(data),
        int(said[1]),
        stack,
        float(said[2]),
        _operations(written),
        float(difference),
    )


def missing() -> str:
    """Return the tool without which nothing is built here; '' if there are all."""
    if not compiler():
        return 'a C compiler'
    return next((tool for tool in ('make', 'ar', 'size') if shutil.which(tool) is None), '')


def _operations(written: Written) -> int | None:
    """Return the operations of a step, which the same source counts as C++; None without C++."""
    from .source import counting_files  # CasADi is slow to load

    cpp = shutil.which('c++') or shutil.which('g++')
    if cpp is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        texts = {file: (written.folder / file).read_text() for file in written.files}
        counting = counting_files(texts, written.name)
        for file, contents in counting.items():
            (here / file).write_text(contents)
        sources = [file for file in counting if file.endswith('.cpp')]
        flags = ['-std=c++17', '-fpermissive', '-w', '-O0', '-DCOUNT']
        try:
            _run(here, [cpp, *flags, *sources, '-o', 'count', '-lm'])
            said = re.search(r'takes (\d+) operations', _run(here, ['./count', 'vectors.txt']))
        except ValueError:  # a compiler of another kind
            return None
    return None if said is None else int(said[1])


def _frames(usage: Path) -> int:
    """Return the sum of the frames of all functions of a file, more than any chain of calls."""
    return sum(int(line.split('\t')[1]) for line in usage.read_text().splitlines())


def _run(folder: Path, command: Sequence[str]) -> str:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE,
            stdin=subprocess.DEVNULL, errors='replace', env={**os.environ, 'LC_ALL': 'C'},
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        raise ValueError(f'{command[0]} failed: {error}') from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if 'error' in line or 'check:' in line]
        said = lines[0] if lines else (done.stderr.splitlines() or [''])[0]
        raise ValueError(f'{command[0]} failed: {said.strip()}')
    return done.stdout
