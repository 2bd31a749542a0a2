# SPDX-License-Identifier: Apache-2.0
"""Finding things by name: a file of a folder of ours, or ``package.module:Name`` of a user's."""

from __future__ import annotations

import importlib
import pkgutil
from difflib import get_close_matches
from typing import Any


def names(package: str) -> list[str]:
    """Return the names that ``package`` offers: its modules. Nothing is imported but itself."""
    path = importlib.import_module(package).__path__
    return sorted(module.name for module in pkgutil.iter_modules(path))


def find(kind: str, name: str, package: str, attribute: str) -> Any:
    """Return ``attribute`` of module ``name`` in ``package``, or what ``module:Name`` names.

    Raises
    ------
    ValueError
        If there is no such module or no such attribute, with the names that there are.
    """
    module, colon, own = name.partition(':')
    if not colon:
        known = names(package)
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean '{near[0]}'? " if near else ''
            raise ValueError(
                f"{kind}: unknown {kind} '{name}'; {hint}known are {', '.join(known)}, "
                "or 'package.module:Name' of your own"
            )
        module, own = f'{package}.{name}', attribute
    try:
        return getattr(importlib.import_module(module), own)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"{kind}: cannot load '{name}': {error}") from None
