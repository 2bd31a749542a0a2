# SPDX-License-Identifier: Apache-2.0
"""The output folder of a program."""

from __future__ import annotations

from pathlib import Path


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
