# SPDX-License-Identifier: Apache-2.0
"""Search for objects by name: a module of this package, or a user's ``package.module:Name``."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import traceback
from functools import cache
from pathlib import Path
from typing import Any

from .named_options import nearest, signature


def names(package: str) -> list[str]:
    """Return the public module names in ``package``.

    Only ``package`` itself is imported.
    """
    return list(_names(package))


@cache
def _names(package: str) -> tuple[str, ...]:
    path = importlib.import_module(package).__path__
    modules = (module.name for module in pkgutil.iter_modules(path))
    return tuple(sorted(name for name in modules if not name.startswith('_')))


def find(kind: str, name: str, package: str, attribute: str) -> Any:
    """Return ``attribute`` of module ``name`` in ``package``, or the object ``module:Name``.

    Raises
    ------
    ValueError
        If there is no such module or attribute; the message lists the names that exist.
    """
    module, colon, target = name.partition(':')
    if not colon:
        known = names(package)
        if name not in known:
            listed = f"known are {', '.join(known)}, or 'package.module:Name' of your own"
            hint = ' '.join(filter(None, (nearest(name, known), listed)))
            raise ValueError(f"{kind}: unknown {kind} '{name}'; {hint}")
        module, target = f'{package}.{name}', attribute
    try:
        return getattr(importlib.import_module(module), target)
    except (ImportError, AttributeError) as error:
        hint = '; is its folder on PYTHONPATH, or its workspace sourced?' if colon else ''
        raise ValueError(f"{kind}: cannot load '{name}': {error}{hint}") from None
    except Exception as error:  # a user's module may raise anything
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise ValueError(
            f"{kind}: cannot load '{name}': {type(error).__name__}: {error}, "
            f'{Path(where.filename).name} line {where.lineno}'
        ) from error


def builds(builder: Any, kind: type) -> bool:
    """Return whether ``builder`` returns a ``kind`` when called; it is not called.

    True for a class of that kind, and for a function whose return annotation is one.
    """
    if inspect.isclass(builder):
        return issubclass(builder, kind)
    if not inspect.isfunction(builder):
        return False
    try:
        returned = signature(builder).return_annotation
    except (NameError, SyntaxError, TypeError, ValueError):
        return False
    return inspect.isclass(returned) and issubclass(returned, kind)


def names_code(parameter: str) -> bool:
    """Return whether a parameter selects a module to import or a file to open.

    These are read only at start-up: `model`, and the `kind` and `type` of each
    signal.
    """
    return parameter.rpartition('.')[2] in _CODE


_CODE = ('model', 'kind', 'type', 'implementation', 'recording', 'datum_file')
