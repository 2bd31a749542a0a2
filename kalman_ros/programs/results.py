# SPDX-License-Identifier: Apache-2.0
"""Where commands leave what they found."""

from __future__ import annotations

from pathlib import Path


def ready(folder: Path) -> Path:
    """Return a folder that there is, before what takes long begins.

    Raises
    ------
    ValueError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f'out: cannot make {folder}: {error.strerror}') from None
    return folder
