# SPDX-License-Identifier: Apache-2.0
"""Finding things by name: a file of a folder of ours, or ``package.module:Name`` of a user's."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import traceback
from pathlib import Path
from typing import Any

from .options import nearest


def names(package: str) -> list[str]:
    """Return the names that ``package`` offers: its modules, but for what they share (``_NAME``).

    Nothing is imported but itself.
    """
    path = importlib.import_module(package).__path__
    found = (module.name for module in pkgutil.iter_modules(path))
    return sorted(name for name in found if not name.startswith('_'))


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
            listed = f"known are {', '.join(known)}, or 'package.module:Name' of your own"
            hint = ' '.join(filter(None, (nearest(name, known), listed)))
            raise ValueError(f"{kind}: unknown {kind} '{name}'; {hint}")
        module, own = f'{package}.{name}', attribute
    try:
        return getattr(importlib.import_module(module), own)
    except (ImportError, AttributeError) as error:
        hint = '; is its folder on PYTHONPATH, or its workspace sourced?' if colon else ''
        raise ValueError(f"{kind}: cannot load '{name}': {error}{hint}") from None
    except Exception as error:  # a module of a user's own may raise anything
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise ValueError(
            f"{kind}: cannot load '{name}': {type(error).__name__}: {error}, "
            f'{Path(where.filename).name} line {where.lineno}'
        ) from error


def builds(found: Any, kind: type) -> bool:
    """Tell whether ``found`` is made to return a ``kind``; nothing is called to find out.

    That is a class of that kind, or a function whose annotation says that it returns one.
    """
    if inspect.isclass(found):
        return issubclass(found, kind)
    if not inspect.isfunction(found):
        return False
    try:
        returned = inspect.signature(found, eval_str=True).return_annotation
    except (NameError, SyntaxError, TypeError, ValueError):
        return False
    return inspect.isclass(returned) and issubclass(returned, kind)


def names_code(parameter: str) -> bool:
    """Tell whether a parameter says which module is imported, or which file is opened.

    Those count only from the start-up parameters of a node: `model`, and of each signal `kind`
    and `type`.
    """
    return parameter.rpartition('.')[2] in _CODE


_CODE = ('model', 'kind', 'type', 'implementation', 'recording')
