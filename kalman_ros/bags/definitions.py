# SPDX-License-Identifier: Apache-2.0
"""The definitions of message types, as recordings carry them for viewers."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

_FIELD = re.compile(r'^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[<=\d]*\])?\s+\w+', re.MULTILINE)
_PLAIN = {'bool', 'byte', 'char', 'string', 'wstring', 'float32', 'float64'}
_PLAIN |= {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}


def definition(kind: str) -> str:
    """Return the definition of ``package/msg/Name`` and of its parts; '' if one is missing."""
    texts: dict[str, str] = {}
    left = [kind]
    while left:
        name = left.pop(0)
        text = _text(name)
        if not text:
            return ''
        texts[name] = text
        left += [used for used in _used(name, text) if used not in texts and used not in left]
    first, *others = texts.items()
    line = f'\n{"=" * 80}\n'
    return line.join((first[1], *(f'MSG: {_short(name)}\n{text}' for name, text in others)))


def _short(name: str) -> str:
    return name.replace('/msg/', '/')


def _text(kind: str) -> str:
    package, _, name = kind.partition('/msg/')
    if not package.isidentifier() or not name.isidentifier():
        return ''
    # where nothing is sourced, ROS may be in the environment of this Python
    for prefix in (*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix):
        path = Path(prefix, 'share', package, 'msg', f'{name}.msg')
        if prefix and path.is_file():
            return path.read_text(errors='replace')
    return ''


def _used(kind: str, text: str) -> list[str]:
    package = kind.partition('/')[0]
    plain = re.sub('#.*', '', text)
    fields = (field for field in _FIELD.findall(plain) if field not in _PLAIN)
    names = (f'{package}/{field}' if '/' not in field else field for field in fields)
    return [name.replace('/', '/msg/') for name in names]
