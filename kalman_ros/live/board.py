# SPDX-License-Identifier: Apache-2.0
"""Content of all tabs of a page: versioned sections, and a sequence of frames."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

#: Number of frames that are kept for a new tab, about half a minute.
_FRAMES = 1000


@dataclass
class Cursor:
    """The state of one tab: versions of received sections, and number of received frames."""

    versions: dict[str, int] = field(default_factory=dict)
    frames: int = 0


class Board:
    """A board of texts that one thread writes and other threads read.

    A slow or new tab receives the newest version of each section and the last frames, so that it
    needs no queue.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._sections: dict[str, tuple[int, str]] = {}
        self._frames: deque[str] = deque(maxlen=_FRAMES)
        self._count = 0
        #: Number of tabs that read the board.
        self.readers = 0
        #: Function that is called after each change, in the thread of the change.
        self.on_change: Callable[[], None] = lambda: None

    def put(self, section: str, value: Mapping[str, Any]) -> None:
        """Replace a section of the board."""
        text = _json({'kind': section, **value})
        with self._lock:
            version, previous = self._sections.get(section, (0, ''))
            if text == previous:
                return
            self._sections[section] = version + 1, text
        self.on_change()

    def add(self, frame: Mapping[str, Any]) -> None:
        """Add a frame to the sequence."""
        text = _json(frame)
        with self._lock:
            self._frames.append(text)
            self._count += 1
        self.on_change()

    def clear(self) -> None:
        """Remove all frames, which belong to an earlier run."""
        with self._lock:
            self._frames.clear()

    def news(self, cursor: Cursor) -> list[str]:
        """Return the changes since a cursor as JSON texts, and advance the cursor."""
        with self._lock:
            texts = []
            for section, (version, text) in self._sections.items():
                if cursor.versions.get(section) != version:
                    cursor.versions[section] = version
                    texts.append(text)
            new_count = min(self._count - cursor.frames, len(self._frames))
            if new_count:
                frames = ','.join(list(self._frames)[-new_count:])
                texts.append(f'{{"kind":"frames","frames":[{frames}]}}')
            cursor.frames = self._count
        return texts


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, separators=(',', ':'), allow_nan=False)
