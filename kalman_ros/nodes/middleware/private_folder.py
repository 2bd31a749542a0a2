# SPDX-License-Identifier: Apache-2.0
"""Temporary folders that do not stay behind, even if their process is killed."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import stat
import tempfile
import time
from contextlib import suppress
from pathlib import Path

#: How the names begin, and what they look like.
_PREFIX = 'kalman_ros_run_'
_NAME = re.compile(rf'{_PREFIX}[a-z0-9_]{{8}}')
#: Younger folders are left alone: their process may not have locked them yet. In seconds.
_YOUNG = 60.0


class PrivateFolder:
    """A temporary folder of this process, locked until `cleanup`; a context manager.

    The lock ends with the process, however that ends. So a folder that is not locked is a
    leftover, which is removed when the next one is made.
    """

    def __init__(self) -> None:
        _remove_leftovers()
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
        self._lock = _locked(self.path)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.cleanup()

    def cleanup(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _locked(path: Path) -> int | None:
    """Return the descriptor of a folder that is locked now; None if another process has it."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # also where the file system has no locks
        os.close(descriptor)
        return None
    return descriptor


def _remove_leftovers() -> None:
    """Remove the folders of processes of this user that are gone; links are not followed."""
    with suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            if _NAME.fullmatch(entry.name):
                with suppress(OSError):
                    _remove(Path(entry.path))


def _remove(path: Path) -> None:
    status = path.lstat()
    old = time.time() - status.st_mtime > _YOUNG
    if not (stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and old):
        return
    lock = _locked(path)
    if lock is not None:
        shutil.rmtree(path, ignore_errors=True)
        os.close(lock)
