# SPDX-License-Identifier: Apache-2.0
"""The set of recordings with injected faults, for the score of the doctor."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from kalman_ros.scenario import shipped

from ..recordings import Recording, edited
from .bag import write_bag
from .cases import TABLE, InjectedRecording

#: Length of each recording (s).
_SECONDS = 60.0


class InjectedSet:
    """Recordings of shipped scenarios, which are written as those of `tools.strangers`."""

    table = TABLE
    recordings: Mapping[str, InjectedRecording] = {case.name: case for case in TABLE}

    def write(self, recording: Recording, folder: str | Path) -> None:
        """Write the two files of a recording into a new or an empty folder."""
        place, injection = Path(folder), self.recordings[recording.name].injection
        parameters = edited(recording, shipped.file(recording.system).read_text())
        bag = place / 'bag'
        write_bag(bag, recording.system, injection, _SECONDS, recording.seed)
        next(bag.glob('*.mcap')).replace(place / 'recording.mcap')
        shutil.rmtree(bag)
        (place / 'robot.yaml').write_text(parameters)
