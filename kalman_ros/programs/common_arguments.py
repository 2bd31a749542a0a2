# SPDX-License-Identifier: Apache-2.0
"""Command line arguments that several programs share."""

from __future__ import annotations

import argparse

from kalman_ros import models


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add the argument SCENARIO, with the default scenario as its default."""
    parser.add_argument(
        'scenario', nargs='?', default=models.DEFAULT,
        help='a name in config/, or a parameter file of your own (default: %(default)s)',
    )  # fmt: skip


def add_parameters(parser: argparse.ArgumentParser, purpose: str) -> None:
    """Add the option -p (``parameters``); its help starts with ``purpose``."""
    parser.add_argument(
        '-p', action='append', default=[], metavar='NAME:=VALUE', dest='parameters',
        help=f'{purpose}; may be repeated',
    )  # fmt: skip
