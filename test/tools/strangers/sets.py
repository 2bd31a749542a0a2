# SPDX-License-Identifier: Apache-2.0
"""The sets of recordings. A name is unique among all sets."""

from __future__ import annotations

from pathlib import Path

from . import recordings
from .eighth import recordings as eighth
from .fifth import recordings as fifth
from .fourth import recordings as fourth
from .real import recordings as real
from .recordings import Recording
from .second import recordings as second
from .seventh import recordings as seventh
from .sixth import recordings as sixth
from .third import recordings as third

#: The recordings of each set, by name.
SETS: dict[str, dict[str, Recording]] = {
    'first': recordings.RECORDINGS,
    'second': second.RECORDINGS,
    'third': third.RECORDINGS,
    'fourth': fourth.RECORDINGS,
    'fifth': fifth.RECORDINGS,
    'sixth': sixth.RECORDINGS,
    'seventh': seventh.RECORDINGS,
    'eighth': eighth.RECORDINGS,
    'real': real.RECORDINGS,
}
#: The recordings of all sets.
RECORDINGS: dict[str, Recording] = {
    name: recording for table in SETS.values() for name, recording in table.items()
}


def write(name: str, folder: str | Path) -> None:
    """Write the two files of a recording of any set into a new or an empty folder."""
    writer = next(
        each
        for each in (recordings, second, third, fourth, fifth, sixth, seventh, eighth, real)
        if name in each.RECORDINGS
    )
    writer.write(name, folder)
