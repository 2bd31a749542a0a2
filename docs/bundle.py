# SPDX-License-Identifier: Apache-2.0
"""Modules of JavaScript as one script, since pages that are opened as files load no modules."""

from __future__ import annotations

import re
from pathlib import Path

EXPLORE = Path(__file__).parent / 'explore'
_IMPORT = re.compile(r"^import \{([^}]*)\} from '([^']+)';\n", re.MULTILINE)
_EXPORT = re.compile(r'^export (const|function|class) (\w+)', re.MULTILINE)


def bundle(*entries: Path) -> str:
    """Return a script with these modules and what they import, each in its scope.

    A module has named imports and exports only; the exports of the last one are the value of the
    script.
    """
    done: dict[Path, str] = {}
    parts = [_part(entry.resolve(), done) for entry in entries]
    return ''.join(done.values()) + parts[-1] + ';\n'


def _part(module: Path, done: dict[Path, str]) -> str:
    """Add a module to those that are done, after what it imports; return its name."""
    name = 'module_' + module.stem
    if module in done:
        return name
    text = module.read_text()
    heads = []
    for names, where in _IMPORT.findall(text):
        other = _part((module.parent / where).resolve(), done)
        heads.append(f'const {{{names.replace(" as ", ": ")}}} = {other};\n')
    body = _EXPORT.sub(r'\1 \2', _IMPORT.sub('', text))
    exports = ', '.join(name for _, name in _EXPORT.findall(text))
    done[module] = (
        f'const {name} = (() => {{\n{"".join(heads)}{body}return {{{exports}}};\n}})();\n'
    )
    return name
