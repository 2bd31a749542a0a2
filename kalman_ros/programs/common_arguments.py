# SPDX-License-Identifier: Apache-2.0
"""Command line arguments that several programs share."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from math import inf
from typing import Any

from kalman_ros import models

#: Forms of two numbers of a name, with what is between them in the middle.
INTERVAL, PRIOR = ('NAME=LOW', '..', 'HIGH'), ('NAME=MEAN', '+-', 'STD')


def add_scenario(parser: argparse._ActionsContainer) -> None:
    """Add the argument SCENARIO, with the default scenario as its default."""
    parser.add_argument(
        'scenario', nargs='?', default=models.DEFAULT,
        help='a name in config/, or a parameter file of your own (default: %(default)s)',
    )  # fmt: skip


class Once(argparse.Action):
    """Argument that is refused if it is given again, instead of the first one being forgotten."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Store the value."""
        if getattr(namespace, self.dest) is not self.default:
            parser.error(f'{option_string}: expected one, got two')
        setattr(namespace, self.dest, values)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the options --from (``start``) and --to (``end``) of a part of a recording."""
    parser.add_argument(
        '--from', type=float, default=0.0, metavar='S', dest='start',
        help='seconds from the start of the recording (default: 0)',
    )  # fmt: skip
    parser.add_argument(
        '--to', type=float, default=inf, metavar='S', dest='end', help='the same for the end'
    )


def add_parameters(parser: argparse.ArgumentParser, purpose: str) -> None:
    """Add the option -p (``parameters``); its help starts with ``purpose``."""
    parser.add_argument(
        '-p', action='append', default=[], metavar='NAME:=VALUE', dest='parameters',
        help=f'{purpose}; may be repeated',
    )  # fmt: skip


def pairs(
    option: str, texts: Iterable[str], form: tuple[str, str, str]
) -> dict[str, tuple[float, float]]:
    """Return pairs of numbers by name.

    Raises
    ------
    ValueError
        If a text has another form, or a name occurs twice.
    """
    by_name: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, numbers = text.partition('=')
        try:
            first, second = map(float, numbers.split(form[1]))
        except ValueError:
            raise ValueError(f"{option}: expected {''.join(form)}, got '{text}'") from None
        if name in by_name:
            raise ValueError(f'{option}: expected one of {name}, got two')
        by_name[name] = first, second
    return by_name
