# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files and command lines, read and written without ROS."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from sys import float_info
from typing import Any, NamedTuple

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser
from yaml.resolver import Resolver

#: The nodes of a loop, and those that may stand between plant and estimator.
NODES = ('estimator', 'controller', 'monitor', 'plant')
BETWEEN = 'microphone_array'
#: The name of a section as similar as this to that of a node is misspelt.
_MISSPELT = 0.93
#: Unquoted words that are strings to PyYAML, and truth values to the YAML of ROS.
_BARE = tuple('yYnN')


class _Bare(str):
    """A string that other YAML readers, such as that of ROS, read as true or false."""


#: Longer files and values are refused before parsing, those with more or deeper values during
#: it: any answer takes at most a second.
_MOST_BYTES, _MOST_VALUES, _DEEPEST = 1_000_000, 10_000, 20


class _ExpensiveError(yaml.composer.ComposerError):  # type: ignore[misc]
    """The text is larger than any parameter file."""


class _Loader(Composer, CParser, SafeConstructor, Resolver):  # type: ignore[misc]
    """PyYAML's safe loader, which reads words as ROS does and refuses expensive files.

    Aliases are refused, as in the parser of ROS: a few lines of them can create any number of
    values. So are tags, which that parser ignores. Text is parsed by libyaml, as in ROS, five
    times as fast as in Python.
    """

    def __init__(self, stream: Any) -> None:
        CParser.__init__(self, stream)
        for part in (Composer, SafeConstructor, Resolver):
            part.__init__(self)
        self._values = self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            why = f"ROS reads no aliases, '*{self.peek_event().anchor}'"
            raise yaml.composer.ComposerError(None, None, why, mark)
        tag = getattr(self.peek_event(), 'tag', None)
        if tag not in (None, '!', 'tag:yaml.org,2002:str'):
            raise yaml.composer.ComposerError(None, None, f"ROS reads no tags, '{tag}'", mark)
        self._values += 1
        if self._values > _MOST_VALUES:
            raise _ExpensiveError(None, None, f'expected at most {_MOST_VALUES} values', mark)
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _ExpensiveError(None, None, f'expected at most {_DEEPEST} levels', mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Return a mapping by names, which are texts as they stand."""
        values = (self.construct_object(value, deep=deep) for _, value in node.value)
        return dict(zip(_names(node), values))

    def construct_number(self, node: Any) -> Any:
        """Return a number, or the text of one that C cannot represent, as ROS does."""
        text = node.value
        if node.tag.endswith('int') and len(text) < 30:
            whole = self.construct_yaml_int(node)
            return whole if -(2**63) <= whole < 2**63 else float(whole)
        value = self.construct_yaml_float(node)
        mantissa = text.lower().partition('e')[0]
        if not any(digit in '123456789' for digit in mantissa):  # 0, inf or nan
            return value
        return value if isfinite(value) and abs(value) >= float_info.min else text


def _names(node: Any) -> list[str]:
    """Return the names in a mapping; ComposerError if one is no text, or stands twice."""
    names: dict[str, None] = {}
    for key, _ in node.value:
        why = '' if isinstance(key, yaml.ScalarNode) else 'expected a name'
        if not why and key.value in names:
            why = f"'{key.value}' stands twice"
        if why:
            raise yaml.composer.ComposerError(None, None, why, key.start_mark)
        names[key.value] = None
    return [*names]


def _load(text: str) -> Any:
    """Return the value of a YAML text: the only place that reads YAML.

    Raises
    ------
    ValueError
        If it is not YAML, or larger than any parameter file; the message has the line.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from None


def _reason(error: yaml.YAMLError) -> str:
    mark = getattr(error, 'problem_mark', None)
    line = f' in line {mark.line + 1}' if mark else ''
    what = getattr(error, 'problem', None) or str(error).partition('\n')[0]
    if not isinstance(error, yaml.composer.ComposerError):
        return f'not YAML: {what}{line}'
    return f'{f"{error.context}, " if error.context else ""}{what}{line}'


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


def bounded_text(path: Path) -> str:
    """Return the text of a file that others will parse, YAML or not.

    Raises
    ------
    ValueError
        If it is larger than any parameter file, or not text.
    OSError
        If it cannot be read.
    """
    text = _read(path)
    try:
        yaml.load(text, _Loader)
    except _ExpensiveError as error:
        raise ValueError(_reason(error)) from None
    except yaml.YAMLError:
        pass
    return text


#: What an unquoted word is, as in the parser of ROS (rcl_yaml_param_parser, parse.c): tag,
#: pattern, and first characters. Its numbers are those of C, so 1e3 is one, and 1_000, 1:30, 0b1
#: and 2001-01-01, which are numbers or dates to PyYAML, are strings; << is a name like any other.
_WORDS = (
    ('!bare', r'[yYnN]', 'yYnN'),
    (
        'tag:yaml.org,2002:bool',
        r'yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF',
        'yYnNtTfFoO',
    ),
    ('tag:yaml.org,2002:int', r'[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)', '-+0123456789'),
    (
        'tag:yaml.org,2002:float',
        r'[-+]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|\.?(inf|Inf|INF)|nan|NaN|NAN)'
        r'|\.(nan|NaN|NAN)',
        '-+.0123456789iInN',
    ),
    ('tag:yaml.org,2002:null', '', ['']),
)
_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in _WORDS:
    _Loader.add_implicit_resolver(_tag, re.compile(f'^(?:{_pattern})$'), list(_first))
_Loader.add_constructor('!bare', lambda loader, node: _Bare(node.value))
for _tag in ('int', 'float'):
    _Loader.add_constructor(f'tag:yaml.org,2002:{_tag}', _Loader.construct_number)


def from_file(path: Path | None, *nodes: str) -> dict[str, Any]:
    """Return the parameters that a ROS parameter file has for a node, flat.

    With several nodes, later ones override earlier ones.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    document = _document(path)
    return _merged(document, path, ['/**', *(key for node in nodes for key in _keys(node))])


def own_section(path: Path | None, node: str) -> dict[str, Any]:
    """Return the parameters in the section of one node in a ROS parameter file, flat.

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
    """Return the parameters of sections, later ones first."""
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
    """Return a YAML text with the words y and n in quotes, and '' in empty lists.

    Other YAML readers, such as that of ROS, read those words as true and false. Text that is not
    YAML is returned unchanged.
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
    """Return the names of the nodes that have a section in a ROS parameter file.

    Raises
    ------
    ValueError
        If the file is not a ROS parameter file.
    """
    return {str(key).rpartition('/')[2] for key in _document(path)}


def _document(path: Path | None) -> Mapping[str, Mapping[str, Any]]:
    """Return the sections of a file by their names there."""
    if path is None:
        return {}
    try:
        document = _load(_read(path)) or {}
    except ValueError as error:
        reason = str(error)
    else:
        if isinstance(document, Mapping) and all(map(_is_section, document.values())):
            known, names = ('**', *NODES, BETWEEN), [str(k).rpartition('/')[2] for k in document]
            for name in names:
                near = [] if name in known else get_close_matches(name, known, 1, _MISSPELT)
                if near and near[0] not in name:  # a second estimator may be estimator_2
                    raise ValueError(
                        f"{path.name}: no node is named '{name}'; did you mean '{near[0]}'?"
                    )
            if not set(names).intersection(known):
                raise ValueError(f'{path.name}: no section is for one of (/{", ".join(known)})')
            return document
        reason = 'not a ROS parameter file: expected NODE: ros__parameters: NAME: VALUE'
    raise ValueError(f'{path.name}: {reason}')


def _is_section(value: Any) -> bool:
    return isinstance(value, Mapping) and isinstance(value.get('ros__parameters'), Mapping)


def _flat(section: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, Mapping):
            parameters.update(_flat(value, f'{prefix}{key}.'))
        else:
            parameters[f'{prefix}{key}'] = value
    return parameters


def section(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the ``values`` whose names start with ``name`` and a dot, without this prefix."""
    start = f'{name}.'
    return {key[len(start) :]: value for key, value in values.items() if key.startswith(start)}


def by_section(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the `section` of each name before a first dot, of all in one pass."""
    parts: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        name, dot, rest = key.partition('.')
        if dot:
            parts.setdefault(name, {})[rest] = value
    return parts


def overrides(given: Sequence[str]) -> dict[str, Any]:
    """Return ``NAME:=VALUE`` arguments as parameters; ValueError if one is malformed."""
    parameters = {}
    for text in given:
        name, separator, value = text.partition(':=')
        try:
            parameters[name] = _load(value)
        except ValueError:
            separator = ''
        if not separator:
            raise ValueError(f"-p: expected NAME:=VALUE, got '{text}'")
    return parameters


class Lined(NamedTuple):
    """A value of a YAML file with its line."""

    value: Any
    line: int


def with_lines(path: Path) -> Lined:
    """Return the value of any YAML file, with mappings of `Lined` values instead of plain ones.

    Raises
    ------
    ValueError
        If it is not YAML, or larger than any parameter file; the message has the line.
    """
    try:
        loader = _Loader(_read(path))
        node = loader.get_single_node()
        return Lined({}, 1) if node is None else _lined(loader, node)
    except yaml.YAMLError as error:
        raise ValueError(f'{path.name}: {_reason(error)}') from None
    except ValueError as error:
        raise ValueError(f'{path.name}: {error}') from None


def _lined(loader: _Loader, node: Any) -> Lined:
    line = node.start_mark.line + 1
    if not isinstance(node, yaml.MappingNode):
        return Lined(loader.construct_document(node), line)
    names = _names(node)
    # the line of a value that begins on a later one is that of its name
    lines = {name: key.start_mark.line + 1 for name, (key, _) in zip(names, node.value)}
    values = {name: _lined(loader, value) for name, (_, value) in zip(names, node.value)}
    return Lined({key: entry._replace(line=lines[key]) for key, entry in values.items()}, line)
