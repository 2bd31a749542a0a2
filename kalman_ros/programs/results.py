# SPDX-License-Identifier: Apache-2.0
"""The output folder of a program."""

from __future__ import annotations

from pathlib import Path

#: The folder of a recording in that of a demo.
RECORDED = 'recording'


def ready(folder: Path) -> Path:
    """Create a folder if it is missing, before a long run starts.

    Raises
    ------
    ValueError
        If the folder cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f'out: cannot make {folder}: {error.strerror}') from None
    return folder


def of_recording(bag: Path, program: str) -> Path:
    """Return the folder of the results of a program on a recording, ``out/NAME/program``.

    The name is that of the recording, or of its folder where `demo` has recorded.
    """
    path = bag.resolve()
    if RECORDED in (path.name, path.parent.name):
        path = path.parent if path.name == RECORDED else path.parent.parent
        name = path.name if path.name != 'against' else f'{path.parent.name}_against'
    else:
        name = path.stem
    return Path('out') / (name or RECORDED) / program
