# SPDX-License-Identifier: Apache-2.0
"""The tables of parameters as entries: each has an address, and is found by the search."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = 'reference/parameters'
_ROW = re.compile(r'^\| `([^`]+)`(\\\*)? \| (.*?) \| (.*?) \| (.*) \|$')
_HEAD = re.compile(r'^\| name \| default .*\n\|[-|]+\|$', re.MULTILINE)
_GROUP = re.compile(r'^(?:#+ |Of the kind )`?([^`\n]+?)`?:?$')


def entries(page: str) -> str:
    """Return the page with an entry in place of each row."""
    text = _HEAD.sub('', page)
    names = Counter(match[1] for line in text.splitlines() if (match := _ROW.match(line)))
    group, lines = '', []
    for line in text.splitlines():
        if found := _GROUP.match(line):
            group = found[1]
        row = _ROW.match(line)
        if not row:
            lines.append(line)
            continue
        name, changes, default, limits, meaning = row.groups()
        label = f'{name} ({group})' if names[name] > 1 else name
        facts = [f'default {default}', limits.strip(), 'changes at run time' if changes else '']
        body = f'{meaning}; {", ".join(filter(None, facts))}'
        lines += [f'```{{confval}} {label}', '', body, '```', '']
    page = '\n'.join(lines).replace('\\|', '|')  # a cell escapes what ends it
    return page.replace('A parameter with \\* may change', 'Some may change') + '\n'


def _read(app: Sphinx, page: str, source: list[str]) -> None:
    if page == PAGE:
        source[0] = entries(source[0])


def setup(app: Sphinx):
    """Rewrite the page of parameters when it is read."""
    app.connect('source-read', _read)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
