# SPDX-License-Identifier: Apache-2.0
"""All recordings on which the doctor is scored: the sets, and those with injected faults."""

from __future__ import annotations

from pathlib import Path

from .injected.recording_set import InjectedSet
from .recordings import Recording
from .sets import SETS, RecordingSet

#: The sets by name; a name of a recording is unique among all.
SCORED: dict[str, RecordingSet | InjectedSet] = {**SETS, 'ours': InjectedSet()}
RECORDINGS: dict[str, Recording] = {
    name: recording for some in SCORED.values() for name, recording in some.recordings.items()
}


def write(name: str, folder: str | Path) -> None:
    """Write the two files of a recording into a new or an empty folder."""
    some = next(each for each in SCORED.values() if name in each.recordings)
    some.write(RECORDINGS[name], folder)
