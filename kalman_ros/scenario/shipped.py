# SPDX-License-Identifier: Apache-2.0
"""The parameter files of this package: the only wiring of its models."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from kalman_ros.core.named_options import nearest

PACKAGE = 'kalman_ros'


@lru_cache(maxsize=1)
def folder() -> Path:
    """Return the folder of the files: in the sources, or in an installation's ``share``.

    Raises
    ------
    ValueError
        If there is none.
    """
    package = Path(__file__).resolve().parents[1]
    installed = [above / 'share' / PACKAGE / 'config' for above in package.parents]
    for place in (package.parent / 'config', *installed):
        if any(place.glob('*.yaml')):
            return place
    raise ValueError(f'{PACKAGE} is installed without its parameter files, share/{PACKAGE}/config')


def names() -> list[str]:
    """Return the names of the scenarios of this package."""
    return sorted(path.stem for path in folder().glob('*.yaml'))


def file(scenario: str | Path) -> Path:
    """Return the parameter file of a scenario: a shipped name, or the path of a YAML file.

    Raises
    ------
    ValueError
        If there is none; the message has the nearest name, or else the known ones.
    """
    if not isinstance(scenario, (str, Path)):
        got = type(scenario).__name__
        raise ValueError(f'scenario: expected a name or one file, and overrides, got a {got}')
    if str(scenario).endswith(('.yaml', '.yml')):
        path = Path(scenario)
        if not path.is_file():
            raise ValueError(f"scenario: no file '{scenario}'")
        return path.resolve()
    known = names()
    if str(scenario) not in known:
        hint = nearest(str(scenario), known) or f'known are {", ".join(known)}'
        raise ValueError(f"scenario: unknown scenario '{scenario}'; {hint}")
    return folder() / f'{scenario}.yaml'
