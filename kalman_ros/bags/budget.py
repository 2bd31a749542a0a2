# SPDX-License-Identifier: Apache-2.0
"""The memory and the work that a recording may take, in proportion to its size on disk."""

from __future__ import annotations

#: Largest number of bytes of one part of a file, and of all that is in memory at a time.
MOST_BLOCK, MOST_PENDING = 1 << 28, 1 << 29
#: Largest number of messages that wait for others.
MOST_WAITING = 50_000
#: Bytes to which any recording may expand, and further bytes for a byte on disk.
FREE_BYTES, MOST_RATIO = 1 << 30, 1000
#: Records that any recording may have, besides one for a byte on disk: the times of messages
#: differ, so that even one without content takes several bytes when it is compressed.
FREE_RECORDS = 1_000_000
#: Bytes in memory that describe a part of a file, or a topic beside its name.
_NOTE = 500


class Budget:
    """Limits of memory and work for opening a recording, or for a pass over its messages.

    The readers of all formats ask it before they read a part or keep something, and report their
    work, so that a small file neither fills the memory nor keeps a program busy for long.

    Parameters
    ----------
    disk
        Bytes that the recording takes on disk.

    Raises
    ------
    ValueError
        By the methods, if the recording exceeds a limit.
    """

    def __init__(self, disk: int) -> None:
        self._disk = disk
        self._bytes = FREE_BYTES + MOST_RATIO * disk
        self._records = FREE_RECORDS + disk
        self._held = 0

    def expand(self, stored: int, size: int) -> None:
        """Account for a part of ``size`` bytes, in ``stored`` bytes on disk, before it is read."""
        if max(stored, size) > MOST_BLOCK:
            raise ValueError(f'a part of {max(stored, size)} bytes, more than {MOST_BLOCK}')
        self._bytes -= size
        if self._bytes < 0:
            raise ValueError(f'{self._disk} bytes on disk expand to more than {MOST_RATIO} times')

    def work(self, records: int) -> None:
        """Account for reading some records, requested or not."""
        self._records -= records
        if self._records < 0:
            most = FREE_RECORDS + self._disk
            raise ValueError(f'more than {most} records or steps for {self._disk} bytes on disk')

    def hold(self, size: int) -> None:
        """Account for bytes that stay in memory until they are released."""
        self._held += size
        if self._held > MOST_PENDING:
            raise ValueError(f'more than {MOST_PENDING} bytes are not in order, or describe parts')

    def release(self, size: int) -> None:
        """Subtract bytes that are not in memory any more."""
        self._held -= size

    def note(self, name: str = '') -> None:
        """Account for the description of a part, or of a topic by its name."""
        self.hold(_NOTE + len(name))
