# SPDX-License-Identifier: Apache-2.0
"""Command line arguments that several programs share."""

from __future__ import annotations

import argparse
from math import inf

from kalman_ros import models


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add the argument SCENARIO, with the default scenario as its default."""
    parser.add_argument(
        'scenario', nargs='?', default=models.DEFAULT,
        help='a name in config/, or a parameter file of your own (default: %(default)s)',
    )  # fmt: skip


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
