# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers that grow, on disk beyond a size, so that long recordings fit in memory."""

from __future__ import annotations

from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np

from kalman_ros.core import Array

#: Largest number of bytes in memory.
_MOST = 1 << 24


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
        self._rows = bytearray()
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
        self._add(b''.join(row), 1)

    def extend(self, *values: Array) -> None:
        """Append rows, by the values (N, ...) of each field."""
        count = len(values[0])
        columns = [field.reshape(count, int(np.prod(field.shape[1:]))) for field in values]
        self._add(np.hstack(columns).tobytes(), count)

    def _add(self, rows: bytes, count: int) -> None:
        self._rows += rows
        self._count += count
        if len(self._rows) > _MOST:
            self._file = self._file or TemporaryFile(prefix='kalman_ros_')  # noqa: SIM115
            self._file.write(self._rows)
            self._rows.clear()

    def columns(self) -> dict[str, Array]:
        """Return each field (N, ...) by its name; no row may follow."""
        width = sum(self._sizes)
        numbers: Any = np.frombuffer(self._rows)
        if self._file is not None:
            self._file.write(self._rows)
            self._file.flush()
            numbers = np.memmap(self._file, float, 'r')
        table = numbers.reshape(self._count, width)
        ends = np.cumsum(self._sizes)
        return {
            name: table[:, end - size : end].reshape(self._count, *shape)
            for (name, shape), size, end in zip(self._fields.items(), self._sizes, ends)
        }
