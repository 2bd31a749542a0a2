# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files and command lines, read and written without ROS."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser
from yaml.resolver import Resolver

#: The nodes of a loop, and what may stand between plant and estimator.
NODES = ('estimator', 'controller', 'monitor', 'plant')
BETWEEN = 'microphone_array'
#: The program that runs a scenario for people; its section has a duration, and parameters that
#: every node gets in a demo.
DEMO = 'demo'


#: Words without quotes that are words to PyYAML, and truth values to the YAML of ROS.
_BARE = tuple('yYnN')


class _Bare(str):
    """A word that other readers of YAML, that of ROS for one, take for true or false."""


#: Files and values that are longer are refused before they are read, those with more values or
#: deeper ones while they are: a second is enough for any answer.
_MOST_BYTES, _MOST_VALUES, _DEEPEST = 1_000_000, 10_000, 20


class _Loader(Composer, CParser, SafeConstructor, Resolver):  # type: ignore[misc]
    """PyYAML's safe loader, which notices such words, and refuses what could take it long.

    It refuses aliases, as the parser of ROS does: a few lines of them make up any number of
    values. Characters are read by libyaml, as those of ROS are, five times as fast as in Python.
    """

    def __init__(self, stream: Any) -> None:
        CParser.__init__(self, stream)
        for part in (Composer, SafeConstructor, Resolver):
            part.__init__(self)
        self._values = self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            raise _refused(f"ROS reads no aliases, '*{self.peek_event().anchor}'", mark)
        self._values += 1
        if self._values > _MOST_VALUES:
            raise _refused(f'expected at most {_MOST_VALUES} values', mark)
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _refused(f'expected at most {_DEEPEST} levels', mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _refused(why: str, mark: Any) -> yaml.YAMLError:
    return yaml.composer.ComposerError(None, None, why, mark)


def _load(text: str) -> Any:
    """Return what a YAML text says: the only place that reads YAML.

    Raises
    ------
    ValueError
        If it is not YAML, or has more in it than any parameter file; with the line.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        line = f' in line {mark.line + 1}' if mark else ''
        what = getattr(error, 'problem', None) or str(error).partition('\n')[0]
        kind = '' if isinstance(error, yaml.composer.ComposerError) else 'not YAML: '
        raise ValueError(f'{kind}{what}{line}') from None


def _read(path: Path) -> str:
    """Return the text of a file, which may be a pipe or a device, if it is not too long."""
    with path.open('rb') as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f'expected at most {_MOST_BYTES} bytes')
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f'not YAML: {error}') from None


_Loader.add_implicit_resolver('!bare', re.compile(r'^[yYnN]$'), list('yYnN'))
_Loader.add_constructor('!bare', lambda loader, node: _Bare(node.value))


def from_file(path: Path | None, *nodes: str) -> dict[str, Any]:
    """Return the parameters that a ROS parameter file has for a node, flat.

    With several nodes, what a later one is told overrides what those before it are.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    document = _document(path)
    return _merged(document, path, ['/**', *(key for node in nodes for key in _keys(node))])


def own_section(path: Path | None, node: str) -> dict[str, Any]:
    """Return what only the section of a node in a ROS parameter file says, flat.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    return _merged(_document(path), path, _keys(node))


def _keys(node: str) -> list[str]:
    return [f'{where}{node}' for where in ('/**/', '', '/')]


def _merged(
    document: Mapping[str, Mapping[str, Any]], path: Path | None, keys: Sequence[str]
) -> dict[str, Any]:
    """Return the parameters of sections, those of the later ones first."""
    merged: dict[str, Any] = {}
    for key in keys:
        merged.update(_flat(document.get(key, {}).get('ros__parameters', {})))
    for name, value in merged.items():
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, _Bare):
                file, why = path.name if path else '', 'for ROS takes it for true or false'
                raise ValueError(f"{file}: {name}: write '{item}' in quotes, {why}")
    return merged


def unambiguous(text: str) -> str:
    """Return the text of a YAML file with the words y and n in quotes, and '' in empty lists.

    Other readers of YAML, that of ROS for one, take those words for true and false. What is not
    YAML is returned as it is.
    """
    edits: list[tuple[int, int, str]] = []
    opened = -1
    try:
        for token in yaml.scan(text, yaml.SafeLoader):
            start, end = token.start_mark.index, token.end_mark.index
            if isinstance(token, yaml.ScalarToken) and token.plain and token.value in _BARE:
                edits.append((start, end, f"'{token.value}'"))
            elif isinstance(token, yaml.FlowSequenceEndToken) and opened >= 0:
                edits.append((start, start, "''"))
            opened = end if isinstance(token, yaml.FlowSequenceStartToken) else -1
    except yaml.YAMLError:
        return text
    for start, end, instead in reversed(edits):
        text = f'{text[:start]}{instead}{text[end:]}'
    return text


def sections(path: Path | None) -> set[str]:
    """Return the names of the nodes that a ROS parameter file has a section for.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    return {str(key).rpartition('/')[2] for key in _document(path)}


def _document(path: Path | None) -> Mapping[str, Mapping[str, Any]]:
    """Return the sections of a file by the names that they have there."""
    if path is None:
        return {}
    try:
        found = _load(_read(path)) or {}
    except ValueError as error:
        reason = str(error)
    else:
        if isinstance(found, Mapping) and all(map(_is_section, found.values())):
            known = ('**', *NODES, BETWEEN)
            if found and not {str(key).rpartition('/')[2] for key in found}.intersection(known):
                raise ValueError(f'{path.name}: no section is for one of (/{", ".join(known)})')
            return found
        reason = 'not a ROS parameter file: expected NODE: ros__parameters: NAME: VALUE'
    raise ValueError(f'{path.name}: {reason}')


def _is_section(value: Any) -> bool:
    return isinstance(value, Mapping) and isinstance(value.get('ros__parameters'), Mapping)


def _flat(section: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, Mapping):
            found.update(_flat(value, f'{prefix}{key}.'))
        else:
            found[f'{prefix}{key}'] = value
    return found


def section(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return those of the ``values`` whose names start with ``name`` and a dot, without these."""
    start = f'{name}.'
    return {key[len(start) :]: value for key, value in values.items() if key.startswith(start)}


def overrides(given: Sequence[str]) -> dict[str, Any]:
    """Return ``NAME:=VALUE`` arguments as parameters; ValueError if one is none."""
    found = {}
    for text in given:
        name, separator, value = text.partition(':=')
        try:
            found[name] = _load(value)
        except ValueError:
            separator = ''
        if not separator:
            raise ValueError(f"-p: expected NAME:=VALUE, got '{text}'")
    return found


def yaml_value(value: Any) -> str:
    """Return a parameter's value as the command line of a node takes it."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return f'[{", ".join(yaml_value(item) for item in value)}]'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(value)).replace('inf', '.inf').replace('nan', '.nan')
    if isinstance(value, str):
        quoted = value.replace("'", "''")
        return f"'{quoted}'"  # else an empty one is nothing, and y is true
    return str(value)
