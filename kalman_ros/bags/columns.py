# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers that grow, on disk beyond a size, so that long recordings fit in memory."""

from __future__ import annotations

from tempfile import TemporaryFile
from typing import IO

import numpy as np

from kalman_ros.core import Array

#: Largest number of bytes in memory.
_MOST = 1 << 26


class Rows:
    """Rows of several fields, appended one by one.

    Parameters
    ----------
    fields
        Shape of each field by its name, in the order in which `append` takes the fields.
    """

    def __init__(self, **fields: tuple[int, ...]) -> None:
        self._fields = fields
        self._sizes = [int(np.prod(shape)) for shape in fields.values()]
        self._blanks = [(size, np.full(size, np.nan).tobytes()) for size in self._sizes]
        #: Single rows one behind the other, and the fields of rows before these.
        self._rows = bytearray()
        self._together: list[list[Array]] = []
        self._held = 0
        self._file: IO[bytes] | None = None
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, *values: Array | None) -> None:
        """Append a row; a field is NaN where its value is None, or has another size."""
        row = [
            blank if value is None or value.size != size else value.tobytes()
            for value, (size, blank) in zip(values, self._blanks)
        ]
        self._rows += b''.join(row)
        self._added(1)

    def extend(self, *values: Array) -> None:
        """Append rows, by the values (N, ...) of each field, which do not change any more."""
        self._split()
        count = len(values[0])
        fields = zip(values, self._sizes)
        self._together.append([field.reshape(count, size) for field, size in fields])
        self._held += 8 * count * sum(self._sizes)
        self._added(count)

    def _added(self, count: int) -> None:
        self._count += count
        if self._held + len(self._rows) > _MOST:
            self._save()

    def _split(self) -> None:
        """Divide single rows into their fields."""
        if self._rows:
            table = np.frombuffer(bytes(self._rows)).reshape(-1, sum(self._sizes))
            self._together.append(np.split(table, np.cumsum(self._sizes)[:-1], axis=1))
            self._held += len(self._rows)
            self._rows.clear()

    def _save(self) -> IO[bytes]:
        """Move the rows to a file, and return it."""
        self._split()
        self._file = self._file or TemporaryFile(prefix='kalman_ros_')  # noqa: SIM115
        for fields in self._together:
            self._file.write(np.hstack(fields).data)
        self._together, self._held = [], 0
        return self._file

    def columns(self) -> dict[str, Array]:
        """Return each field (N, ...) by its name; no row may follow."""
        if self._file is None:
            self._split()
            blank = [np.empty((0, size)) for size in self._sizes]
            fields = [np.concatenate(parts) for parts in zip(*self._together or [blank])]
        else:
            file = self._save()
            file.flush()
            table = np.memmap(file, float, 'r').reshape(self._count, sum(self._sizes))
            fields = np.split(table, np.cumsum(self._sizes)[:-1], axis=1)
        return {
            name: field.reshape(self._count, *shape)
            for (name, shape), field in zip(self._fields.items(), fields)
        }
