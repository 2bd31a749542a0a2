# SPDX-License-Identifier: Apache-2.0
"""Runs random estimators on hostile input until the first broken promise."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from .engine import BrokenPromiseError, Episode


def main(argv: Sequence[str] | None = None) -> None:
    """Run episodes up to a number of steps; exit 1 if one breaks a promise."""
    parser = argparse.ArgumentParser(prog='fuzz', description=__doc__)
    parser.add_argument('--steps', type=int, default=100_000, help='default: 100 000')
    parser.add_argument('--seed', type=int, default=0, help='of the first episode (default: 0)')
    options = parser.parse_args(argv)
    columns = TextColumn('steps'), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    filters: Counter[str] = Counter()
    models: Counter[str] = Counter()
    seed = options.seed
    try:
        with Progress(*columns) as progress, np.errstate(all='ignore'):
            task = progress.add_task('', total=options.steps)
            while not progress.finished:
                episode = Episode(seed)
                for _ in episode.run():
                    filters[episode.filter] += 1
                    models[episode.model] += 1
                progress.update(task, completed=filters.total())
                seed += 1
    except BrokenPromiseError as violation:
        sys.exit(f'FAIL after {filters.total()} steps: {violation}')
    total = filters.total()
    print(f'PASS, {total} of {total} steps: no promise is broken; {dict(filters)}, {dict(models)}')
