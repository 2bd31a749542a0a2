# SPDX-License-Identifier: Apache-2.0
"""Writes recordings, and scores the doctor on them: ``./dev strangers``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from kalman_ros.core import refuse_unknown
from kalman_ros.programs.refusal import refuse

from .page import write_page
from .score import score
from .scored import SCORED, write


def main(argv: Sequence[str] | None = None) -> None:
    """Write the recordings with these names, or all, a folder each; or score the doctor."""
    parser = argparse.ArgumentParser(
        prog='strangers', description='Write recordings whose faults are known.'
    )
    parser.add_argument('names', nargs='*', metavar='NAME', help='of recordings (default: all)')
    parser.add_argument(
        '--out', type=Path, default=Path('out/strangers'), metavar='DIR',
        help='for a folder each (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--set', choices=[*SCORED], default='first', help='of recordings (default: %(default)s)'
    )
    parser.add_argument('--list', action='store_true', help='print the truths, and write nothing')
    parser.add_argument(
        '--score', action='store_true', help='run the doctor on the recordings in --out, and judge'
    )
    parser.add_argument(
        '--page', type=Path, metavar='FILE',
        help='write the results of all sets in --out, a folder SET each, as a page',
    )  # fmt: skip
    parser.add_argument(
        '--limit', type=float, default=300.0, metavar='S',
        help='for one run of the doctor (default: %(default)g)',
    )  # fmt: skip
    options = parser.parse_args(argv)
    chosen = SCORED[options.set].recordings
    try:
        refuse_unknown(options.names, chosen, 'recording')
        if options.page:
            write_page(options.page, options.out)
            return
        if options.score:
            score(options.names or [*chosen], options.out, options.limit)
            return
        for name in options.names or chosen:
            if options.list:
                print(f'{name:28}  {chosen[name].truth}')
            else:
                write(name, options.out / name)
                print(options.out / name, flush=True)
    except (ValueError, OSError) as error:
        refuse('strangers', error)
