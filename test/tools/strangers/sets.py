# SPDX-License-Identifier: Apache-2.0
"""The sets of recordings. A name is unique among all sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import numpy as np

from .messages import Form
from .recordings import Recording, write_files
from .simulation import Readings
from .systems import System


@dataclass(frozen=True)
class RecordingSet:
    """Recordings of some systems.

    Parameters
    ----------
    table
        Recordings, those of systems that cannot be simulated here included.
    systems
        Systems by name.
    forms
        The type and the bytes of each form of messages.
    """

    table: Sequence[Recording]
    systems: Mapping[str, System]
    forms: Mapping[str, tuple[str, Form]]
    #: The recordings that can be written here, by name.
    recordings: dict[str, Recording] = field(init=False)

    def __post_init__(self) -> None:
        known = {each.name: each for each in self.table if each.system in self.systems}
        object.__setattr__(self, 'recordings', known)

    def write(self, recording: Recording, folder: str | Path) -> None:
        """Write the two files of a recording into a new or an empty folder."""
        write_files(recording, self.systems[recording.system], folder, self.forms)

    def readings(self, recording: Recording) -> Readings:
        """Return the readings of a recording with its fault, in full length."""
        system, rng = self.systems[recording.system], np.random.default_rng(recording.seed)
        readings = system.simulate(rng, {**system.physics, **recording.physics})
        recording.fault(readings, rng)
        return readings


def _imported(folder: str) -> RecordingSet:
    """Return the set whose modules are in a folder beside this one, or here."""
    parts = (import_module(f'{__package__}{folder}.{name}')
             for name in ('recordings', 'systems', 'messages'))  # fmt: skip
    recordings, systems, messages = parts
    return RecordingSet(recordings.TABLE, systems.SYSTEMS, messages.FORMS)


_OTHERS = (
    'second', 'third', 'fourth', 'fifth', 'sixth', 'seventh', 'eighth', 'ninth',
    'tenth', 'eleventh', 'twelfth', 'thirteenth', 'real',
)  # fmt: skip
SETS = {'first': _imported(''), **{name: _imported(f'.{name}') for name in _OTHERS}}
#: The recordings of all sets.
RECORDINGS = {name: each for some in SETS.values() for name, each in some.recordings.items()}


def write(name: str, folder: str | Path) -> None:
    """Write the two files of a recording of any set into a new or an empty folder."""
    some = next(each for each in SETS.values() if name in each.recordings)
    some.write(some.recordings[name], folder)
