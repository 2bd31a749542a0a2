# SPDX-License-Identifier: Apache-2.0
"""What ``--help`` says of a node: what it does, and every parameter that it has."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from textwrap import fill
from typing import Any

from .parameters import given

_WIDTH = 96


def wants_help(arguments: Iterable[str]) -> bool:
    """Tell whether somebody asks for help on a node's command line."""
    return bool({'-h', '--help'}.intersection(arguments))


def usage(node: Any) -> str:
    """Return the help of a node that is configured: its parameters are those that it would use."""
    name = node.get_name()
    about = (sys.modules[type(node).__module__].__doc__ or '').partition('\n')[0]
    lines = [
        f'usage: {name} [--ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO]]',
        '',
        about,
        '',
        'Parameters, with the values that they would have:',
    ]
    for key, value in sorted(given(node).items()):
        descriptor = node.describe_parameter(key)
        when = '' if descriptor.read_only else ' (may change while it runs)'
        lines.append(f'  {key}: {_text(value)}')
        lines.append(_indented(f'{descriptor.description}{when}'))
    return '\n'.join(lines)


def _text(value: Any) -> str:
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, (bool, int, float)):
        return f'{value}'.lower()
    return f'[{", ".join(map(_text, value))}]'


def _indented(text: str) -> str:
    return fill(text, _WIDTH, initial_indent=' ' * 6, subsequent_indent=' ' * 6)
