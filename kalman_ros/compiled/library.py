# SPDX-License-Identifier: Apache-2.0
"""Compiles C, once for each source and compiler, and loads what results.

What is loaded is run, so it is taken only from a folder that nobody else can write to.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import shlex
import shutil
import signal
import stat
import subprocess
import tempfile
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from threading import Event, Lock
from time import time

#: Functions marked FAST are compiled for wider registers, too, and loops marked UNROLLED repeated.
#: Where registers are WIDE, whole rows take less time than halves of them.
FAST = """/* the processor of this machine may have wider registers than all of its kind */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define FAST __attribute__((target_clones("avx2", "default")))
#define INLINE static inline __attribute__((always_inline))
#define UNROLLED _Pragma("GCC unroll 16")
#define WIDE 1
#else
#define FAST
#define INLINE static inline
#define UNROLLED
#define WIDE 0
#endif
"""
#: Beginning of a source in C, with the macros of this package.
HEAD = f"""#include <math.h>
#include <string.h>
typedef double real;
{FAST}"""

_FLAGS = ('-O3', '-ffp-contract=off', '-fPIC', '-shared', '-w', '-Wno-psabi')
#: A compiler that takes longer, in seconds, is given up.
_PATIENCE = 60.0
#: Its version is known within this many seconds.
_SOON = 5.0


#: A digest ends each file, which the loader of the system does not read.
_SEAL = sha256().digest_size
#: What an interrupted compilation left behind is removed after this long, in seconds.
_STALE = 3600.0


class CompilerError(RuntimeError):
    """A source that is not compiled here, with the reason.

    Parameters
    ----------
    reason
        In one line.
    pending
        The source, if a compiler has not tried yet.
    """

    def __init__(self, reason: str, pending: str = '') -> None:
        super().__init__(reason)
        self.pending = pending


@lru_cache(maxsize=1)
def compiler() -> tuple[str, ...]:
    """Return the command of the C compiler: ``CC``, cc, gcc or clang; none if there is none."""
    wanted = shlex.split(os.environ.get('CC', ''))
    for command in (wanted, ['cc'], ['gcc'], ['clang']):
        if command and shutil.which(command[0]):
            return tuple(command)
    return ()


@lru_cache(maxsize=1)
def _version(command: tuple[str, ...]) -> str | CompilerError:
    try:
        return _run([*command, '--version'], _SOON)
    except (OSError, subprocess.SubprocessError) as error:
        return CompilerError(f'the C compiler failed: {_reason(error)}')


#: The compiler that runs, with all that it started; one in a process.
_running: list[subprocess.Popen[str]] = []
_one_at_a_time, _guard, _ended = Lock(), Lock(), Event()


def _run(command: list[str], seconds: float) -> str:
    """Return the output of a command; none of its processes outlives its time or this one."""
    with _guard:
        if _ended.is_set():
            raise subprocess.SubprocessError('this process ends')
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            encoding='utf-8', errors='replace', start_new_session=True,
        )  # fmt: skip
        _running.append(process)
    try:
        output, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        _kill(process)
        raise subprocess.TimeoutExpired(command[0], seconds) from None
    except BaseException:
        _kill(process)
        raise
    finally:
        _running.remove(process)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command[0], output, errors)
    return output


def _kill(process: subprocess.Popen[str]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


@atexit.register
def stop() -> None:
    """End the compilers of this process, for good."""
    with _guard:
        _ended.set()
        for process in _running:
            _kill(process)


def folder() -> Path | None:
    """Return the private folder of compiled libraries; None if there cannot be one.

    It is ``kalman_ros`` in ``XDG_CACHE_HOME``, or in ``~/.cache``.
    """
    base = os.environ.get('XDG_CACHE_HOME', '')
    try:
        path = (Path(base) if Path(base).is_absolute() else Path.home() / '.cache') / 'kalman_ros'
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        return path if _is_private(path.lstat(), stat.S_ISDIR) else None
    except (OSError, RuntimeError):
        return None


def _is_private(status: os.stat_result, kind: object) -> bool:
    """Return whether a file of a kind is ours, and nobody else can write to it."""
    assert callable(kind)
    ours = status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return bool(kind(status.st_mode)) and ours


#: What was loaded by this process, or why it could not be.
_known: dict[str, ctypes.CDLL | CompilerError] = {}


def load(source: str, *, wait: bool = True) -> ctypes.CDLL:
    """Return the library of a source, from the cache or compiled.

    Raises
    ------
    CompilerError
        If there is no compiler, it fails, or it is not to be waited for.
    """
    command = compiler()
    if not command:
        raise CompilerError('no C compiler was found')
    version = _version(command)
    if isinstance(version, CompilerError):
        raise version
    key = '\0'.join((source, *command, *_FLAGS, version))
    name = f'{sha256(key.encode()).hexdigest()}.so'
    outcome = _known.get(name) or _cached(name)
    if outcome is None and not wait:
        raise CompilerError('it is being compiled', source)
    if outcome is None:
        with _one_at_a_time:
            outcome = _known.get(name) or _cached(name) or _made(command, source, name)
    _known[name] = outcome
    if isinstance(outcome, CompilerError):
        raise outcome
    return outcome


def _made(command: tuple[str, ...], source: str, name: str) -> ctypes.CDLL | CompilerError:
    """Return what a compiler makes of a source, or why there is none."""
    try:
        return _anywhere(command, source, name)
    except (OSError, subprocess.SubprocessError) as error:
        return CompilerError(f'the C compiler failed: {_reason(error)}')


def _cached(name: str) -> ctypes.CDLL | None:
    """Return what an earlier process compiled; None if that is not there, or not safe."""
    cache = folder()
    try:
        if cache is not None and _is_private((cache / name).lstat(), stat.S_ISREG):
            whole = (cache / name).read_bytes()
            if sha256(whole[:-_SEAL]).digest() == whole[-_SEAL:]:
                return ctypes.CDLL(str(cache / name))
    except OSError:
        pass  # there is none, or it cannot be loaded
    return None


def _anywhere(command: tuple[str, ...], source: str, name: str) -> ctypes.CDLL:
    """Compile in the cache, or in a temporary folder where that has no room."""
    cache = folder()
    if cache is not None:
        try:
            _remove_stale(cache)
            return _compiled(command, source, cache, name)
        except (OSError, subprocess.CalledProcessError):
            pass  # the disk is full, or cannot be written to, or runs nothing
    with tempfile.TemporaryDirectory() as temporary:
        return _compiled(command, source, Path(temporary), name)


def _remove_stale(cache: Path) -> None:
    for left in cache.glob('.*'):
        if time() - left.lstat().st_mtime > _STALE:
            shutil.rmtree(left, ignore_errors=True)


def _compiled(command: tuple[str, ...], source: str, folder: Path, name: str) -> ctypes.CDLL:
    """Compile into a folder, whole or not at all, and load."""
    with tempfile.TemporaryDirectory(dir=folder, prefix='.') as scratch:
        text, library = Path(scratch) / 'source.c', Path(scratch) / name
        text.write_text(source)
        _run([*command, *_FLAGS, '-o', str(library), '-x', 'c', str(text), '-lm'], _PATIENCE)
        library.chmod(0o700)
        with library.open('ab') as whole:  # a loader may crash on what a power cut left of it
            whole.write(sha256(library.read_bytes()).digest())
        library.replace(folder / name)
    return ctypes.CDLL(str(folder / name))


def _reason(error: Exception) -> str:
    output = getattr(error, 'stderr', None) or str(error)
    return str(output).strip().partition('\n')[0]
