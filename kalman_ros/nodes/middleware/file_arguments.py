# SPDX-License-Identifier: Apache-2.0
"""Parameter files and arguments that ROS would misread, corrected before it reads them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from kalman_ros.core import Value
from kalman_ros.scenario.parameter_files import bounded_text, overrides, unambiguous

from .private_folder import PrivateFolder

_FILE, _EMPTY = '--params-file', re.compile(r':=\s*\[\s*\]$')
#: Parts of rcl's errors about lists of several types, and what helps.
_HINTS = {
    "Value type 'bool'":
        "ROS reads y, n, yes, no, on and off as true or false: write such words in quotes, 'y'",
    "Value type 'double'": 'ROS takes lists of one type: write 0.0 for 0 beside 0.5',
    "Value type 'integer'": 'ROS takes lists of one type: write 0.0 for 0 beside 0.5',
}  # fmt: skip


@contextmanager
def readable(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Return arguments for ``rclpy.init`` in which words such as y, and empty lists, are strings.

    ``ros2 param dump`` writes the string y without quotes, and ROS reads it back as true; an empty
    list has no type, and ROS refuses to declare it. Files are not changed: a corrected copy
    replaces them.

    Raises
    ------
    ValueError
        If a file is larger than any parameter file: parsing it would take minutes.
    """
    words = [_EMPTY.sub(":=['']", argument) for argument in arguments]
    with PrivateFolder() as folder:
        for index, argument in enumerate(words[:-1]):
            if argument == _FILE:
                words[index + 1] = _copied(Path(words[index + 1]), folder / f'{index}.yaml')
        yield words


def overruled(arguments: Sequence[str], values: Mapping[str, Value]) -> list[str]:
    """Return the names of ``-p NAME:=VALUE`` arguments that have another value.

    ROS lets the section of a file for the node win over arguments for every node.
    """
    typed: dict[str, Any] = {}
    for flag, argument in pairwise(arguments):
        name = argument.partition(':=')[0]
        if flag in ('-p', '--param') and ':' not in name:
            with suppress(ValueError):
                typed.update(overrides([argument]))
    return [
        name for name, value in typed.items() if name in values and not _same(value, values[name])
    ]


def _same(typed: Any, value: Any) -> bool:
    """Return whether a value is the one that was typed; without a type, an empty list is ['']."""
    if isinstance(typed, list):
        items = [item for item in value if item != ''] if isinstance(value, Iterable) else [value]
        return len(typed) == len(items) and all(map(_same, typed, items))
    return bool(typed == value or (typed != typed and value != value))


def hint(reason: str) -> str:
    """Return why rcl refused its arguments, with what helps if a list has several types."""
    return next((f'{reason}; {words}' for part, words in _HINTS.items() if part in reason), reason)


def _copied(path: Path, copy: Path) -> str:
    """Return the path of a file that ROS reads correctly: ``path`` itself, or a copy."""
    try:
        text = bounded_text(path)
    except OSError:
        return str(path)  # ROS reports the error
    except ValueError as error:
        raise ValueError(f"params-file '{path.name}': {error}") from None
    put_right = unambiguous(text)
    if put_right == text and path.is_file():
        return str(path)
    # what was read from a pipe is gone from it
    copy.write_text(put_right)
    return str(copy)
