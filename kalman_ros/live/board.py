# SPDX-License-Identifier: Apache-2.0
"""What all tabs of a page see: sections, each with a version, and a sequence of frames."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

#: Frames that are kept for a new tab: half a minute of them.
_FRAMES = 600


@dataclass
class Cursor:
    """What one tab has received: versions of sections, and the number of frames."""

    versions: dict[str, int] = field(default_factory=dict)
    frames: int = 0


class Board:
    """Texts written by one thread and read by others.

    A tab that is slow, or new, receives the newest version of each section and the last frames,
    so it costs no memory.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._sections: dict[str, tuple[int, str]] = {}
        self._frames: deque[str] = deque(maxlen=_FRAMES)
        self._count = 0
        #: Called after each change, by the thread that makes it.
        self.on_change: Callable[[], None] = lambda: None

    def put(self, section: str, value: Mapping[str, Any]) -> None:
        """Replace a section."""
        text = _json({'kind': section, **value})
        with self._lock:
            version, before = self._sections.get(section, (0, ''))
            if text == before:
                return
            self._sections[section] = version + 1, text
        self.on_change()

    def add(self, frame: Mapping[str, Any]) -> None:
        """Add a frame."""
        text = _json(frame)
        with self._lock:
            self._frames.append(text)
            self._count += 1
        self.on_change()

    def clear(self) -> None:
        """Forget all frames: their time is over."""
        with self._lock:
            self._frames.clear()

    def news(self, cursor: Cursor) -> list[str]:
        """Return what has changed since a cursor, as JSON texts, and advance it."""
        with self._lock:
            found = []
            for section, (version, text) in self._sections.items():
                if cursor.versions.get(section) != version:
                    cursor.versions[section] = version
                    found.append(text)
            fresh = min(self._count - cursor.frames, len(self._frames))
            if fresh:
                frames = ','.join(list(self._frames)[-fresh:])
                found.append(f'{{"kind":"frames","frames":[{frames}]}}')
            cursor.frames = self._count
        return found


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, separators=(',', ':'), allow_nan=False)
