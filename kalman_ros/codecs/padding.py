# SPDX-License-Identifier: Apache-2.0
"""Separation of the data in a serialised message from padding with arbitrary values.

Plain CDR aligns every number to its own size, counted from after the first four bytes (OMG,
DDSI-RTPS 2.5, chapter 10; Common Object Request Broker Architecture 3.4, section 9.3).
"""

from __future__ import annotations

from typing import Any

_ENCAPSULATION = 4
_SIZES = {
    **dict.fromkeys(('boolean', 'octet', 'char', 'int8', 'uint8'), 1),
    **dict.fromkeys(('int16', 'uint16'), 2),
    **dict.fromkeys(('int32', 'uint32', 'float'), 4),
    **dict.fromkeys(('int64', 'uint64', 'double'), 8),
}


def without_padding(data: bytes, message: Any) -> bytes:
    """Return ``data``, which is ``message`` serialised, with zeros as padding.

    Raises
    ------
    NotImplementedError
        If the message has wide strings, whose size on the wire differs between implementations.
    """
    clean = bytearray(len(data))
    clean[:_ENCAPSULATION] = data[:_ENCAPSULATION]
    walk = _Walk()
    walk.structure(message)
    for start, end in walk.used:
        start, end = start + _ENCAPSULATION, end + _ENCAPSULATION
        clean[start:end] = data[start:end]
    return bytes(clean)


class _Walk:
    """Traversal of a message in serialisation order, which marks the bytes in use."""

    def __init__(self) -> None:
        self._at = 0
        self.used: list[tuple[int, int]] = []

    def structure(self, message: Any) -> None:
        for name, kind in message.get_fields_and_field_types().items():
            self._value(getattr(message, name), kind)

    def _value(self, value: Any, kind: str) -> None:
        if kind in _SIZES:
            self._use(_SIZES[kind], _SIZES[kind])
        elif kind.startswith('string'):
            self._use(4, 4)
            self._use(len(value.encode()) + 1, 1)
        elif kind.startswith('wstring'):
            raise NotImplementedError('wide strings')
        elif kind.startswith('sequence<'):
            self._use(4, 4)
            self._elements(value, kind[len('sequence<') : -1].partition(',')[0])
        elif kind.endswith(']'):
            self._elements(value, kind.partition('[')[0])
        else:
            self.structure(value)

    def _elements(self, values: Any, kind: str) -> None:
        for value in values:
            self._value(value, kind)

    def _use(self, size: int, alignment: int) -> None:
        start = self._at + -self._at % alignment
        self._at = start + size
        self.used.append((start, self._at))
