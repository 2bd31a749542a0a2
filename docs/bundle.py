# SPDX-License-Identifier: Apache-2.0
"""What the pictures with handles load: one script, since files load no modules, and colours."""

from __future__ import annotations

import re
from pathlib import Path

EXPLORE = Path(__file__).parent / 'explore'
_IMPORT = re.compile(r"^import \{([^}]*)\} from '([^']+)';\n", re.MULTILINE)
#: Colours of the live page, by the rule that sets them.
_LIVE = EXPLORE.parents[1] / 'kalman_ros' / 'live' / 'page' / 'live.css'
_COLOURS = re.compile(
    r'^:root(\.dark)? \{\n  color-scheme: \w+;\n(.*?)^\}', re.MULTILINE | re.DOTALL
)
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


def palette() -> str:
    """Return the colours of the live page for these pages, whose theme a person may choose."""
    colours = {bool(dark): values for dark, values in _COLOURS.findall(_LIVE.read_text())}
    by_system = f'body:not([data-theme=light]) {{\n{colours[True]}}}'
    return (
        f'body {{\n{colours[False]}}}\nbody[data-theme=dark] {{\n{colours[True]}}}\n'
        f'@media (prefers-color-scheme: dark) {{\n{by_system}\n}}\n'
    )
