# SPDX-License-Identifier: Apache-2.0
"""The text of ``--help`` of a node: its purpose, and every parameter, in groups."""

from __future__ import annotations

import sys
from collections.abc import Container, Iterable, Mapping
from textwrap import fill
from typing import Any

from kalman_ros.core import Option

from .parameters import given

_WIDTH = 80
_SIGNALS = ('state', 'input')


def wants_help(arguments: Iterable[str]) -> bool:
    """Return whether a node's command line asks for help."""
    return bool({'-h', '--help'}.intersection(arguments))


def usage(node: Any) -> str:
    """Return the help of a configured node with the parameters that it uses."""
    name = node.get_name()
    about = (sys.modules[type(node).__module__].__doc__ or '').partition('\n')[0]
    arguments = '--ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO]'
    lines = [
        fill(f'usage: {name} {arguments}', _WIDTH, subsequent_indent='    '),
        '',
        fill(about, _WIDTH),
        '',
        'Parameters and their values; * may change at run time.',
    ]
    values = dict(sorted(given(node).items()))
    unused = _unused(values, node.known)
    for name in [name for names in unused.values() for name in names]:
        del values[name]
    for title, entries in _groups(values).items():
        lines += ['', f'{title}:']
        for key, same in entries.items():
            descriptors = node.describe_parameters(list(same))
            mark = '' if descriptors[0].read_only else '*'
            meanings = dict.fromkeys(descriptor.description for descriptor in descriptors)
            if key.startswith('SIGNAL.'):  # the state and the input
                meanings = dict.fromkeys(meaning.rpartition(' of the ')[0] for meaning in meanings)
            meaning = '; '.join(meanings)
            lines.append(_entry(f'{key}{mark}: {_merged(same)}', meaning))
    if unused:
        lines += ['', 'Not used, all at their defaults (docs/reference/parameters.md):']
        sensors = _sensors(values)
        for feature, names in unused.items():
            titles = dict.fromkeys(_title(name, sensors) for name in names)
            lines.append(_entry(f'{feature}: {_together(titles)}', ''))
    return '\n'.join(lines)


def _together(titles: Iterable[str]) -> str:
    """Return titles as text, what several begin with once: ``SENSOR.still.below, duration``."""
    groups: dict[str, list[str]] = {}
    for title in titles:
        start, dot, last = title.rpartition('.')
        groups.setdefault(f'{start}{dot}', []).append(last)
    return ', '.join(f'{start}{", ".join(last)}' for start, last in groups.items())


def _unused(values: Mapping[str, Any], known: Mapping[str, Option]) -> dict[str, list[str]]:
    """Return the parameters of each feature of which all have their defaults."""
    features: dict[str, list[str]] = {}
    for name in values:
        if name in known and known[name].about.feature:
            features.setdefault(known[name].about.feature, []).append(name)
    return {
        feature: names
        for feature, names in features.items()
        if all(known[name].check(values[name]) == known[name].default for name in names)
    }


def _sensors(values: Mapping[str, Any]) -> list[str]:
    listed = values.get('sensors')  # missing on an unconfigured node
    return [str(sensor) for sensor in listed if sensor] if isinstance(listed, list) else []


def _title(name: str, sensors: Container[str]) -> str:
    """Return the name under which a parameter of a sensor is listed with those of others."""
    section, _, key = name.partition('.')
    return f'SENSOR.{key}' if section in sensors else name


def _groups(values: Mapping[str, Any]) -> dict[str, dict[str, dict[str, str]]]:
    """Return the listed names in groups, each with the parameters that it represents.

    Parameters that all sensors, or state and input, have in common are listed once.
    """
    sensors = _sensors(values)
    model, listed, topics, others = ({}, {}, {}, {})  # type: ignore[var-annotated]
    for name, value in values.items():
        section, _, key = name.partition('.')
        if section in ('model', 'model_parameters'):
            group, title = model, name
        elif section in sensors:
            group, title = listed, _title(name, sensors)
        elif section in _SIGNALS and key:
            group, title = topics, f'SIGNAL.{key}'
        else:
            group, title = others, name
        group.setdefault(title, {})[name] = _text(value)
    groups = {
        'The model': model,
        f'The sensors, {" and ".join(sensors)}': listed,
        'Signals, state and input': topics,
        'The node': others,
    }
    return {title: names for title, names in groups.items() if names}


def _merged(values: Mapping[str, str]) -> str:
    """Return the value of parameters that are listed together: one if all are equal."""
    if len({*values.values()}) == 1:
        return next(iter(values.values()))
    return '; '.join(f'{name.partition(".")[0]} {text}' for name, text in values.items())


def _entry(what: str, meaning: str) -> str:
    """Return a parameter and its description, on as few lines as possible."""
    text = f'{what}  ({meaning})' if meaning else what
    return fill(text, _WIDTH, initial_indent='  ', subsequent_indent=' ' * 6)


def _text(value: Any) -> str:
    if isinstance(value, str):
        return repr(value)
    if isinstance(value, (bool, int, float)):
        return f'{value}'.lower()
    return f'[{", ".join(map(_text, value))}]'
