# SPDX-License-Identifier: Apache-2.0
"""Fits simulated recordings, and counts how often the intervals cover the truth."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import track

from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready
from kalman_ros.simulation.spread import spread

from .coverage_cases import COVERED, HIDDEN, IDENTIFIED, Case, likelihood, recorded
from .coverage_page import page

#: Of the recordings of a case, the share of those with parameters that are hidden, or a minute.
_FEWER = 10


@dataclass(frozen=True)
class Estimate:
    """A parameter in one recording: the truth, the fit, and its 95 % interval.

    ``reason`` says why it is not determined; '' if it is.
    """

    name: str
    true: float
    value: float
    low: float
    high: float
    reason: str

    @property
    def covers(self) -> bool:
        """Whether the truth is in the interval."""
        return self.low <= self.true <= self.high

    @property
    def error(self) -> float:
        """The error, relative to the truth unless that is zero."""
        return abs(self.value - self.true) / (abs(self.true) or 1.0)


@dataclass(frozen=True)
class Row:
    """The fit of one recording, and its processor time in seconds."""

    case: str
    seed: int
    converged: bool
    seconds: float
    estimates: list[Estimate]


def fitted(case: Case, seed: int) -> Row:
    """Return the fit of a recording."""
    true = NamedParameters(case.values).choose(list(case.fitted))
    observed = likelihood(case, recorded(case, seed))
    start = time.process_time()
    found = fit(observed)
    spent = time.process_time() - start
    estimates = [
        Estimate(
            each.name, case.errors.get(each.name, one.start), each.value, each.low, each.high,
            each.reason,
        )
        for one, each in zip(true, found.parameters)
    ]  # fmt: skip
    return Row(case.name, seed, found.converged, spent, estimates)


def planned(recordings: int, only: str = '') -> list[tuple[Case, int]]:
    """Return the recordings to fit: a case and a seed each."""
    fewer = max(1, recordings // _FEWER)
    counts = [(each, recordings) for each in COVERED]
    counts += [(each, fewer) for each in (*HIDDEN, *IDENTIFIED)]
    # in turns, so that an interrupted run has some of each
    rows = [(k / count, case, k) for case, count in counts for k in range(count)]
    return [(case, k) for _, case, k in sorted(rows, key=lambda row: row[0]) if only in case.name]


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog='tune --coverage', description=__doc__)
    parser.add_argument(
        '--recordings', type=int, default=200, metavar='N',
        help='of each of the three main cases (default: %(default)d)',
    )  # fmt: skip
    parser.add_argument('--only', default='', metavar='TEXT', help='cases with it in their name')
    parser.add_argument(
        '--workers', type=int, default=1, metavar='N', help='processes (default: %(default)d)'
    )
    parser.add_argument(
        '--resume', action='store_true', help='keep the recordings that were fitted before'
    )
    parser.add_argument('--out', type=Path, default=Path('out/tune_coverage'), metavar='DIR')
    parser.add_argument(
        '--page', type=Path, metavar='FILE', help='where the page goes (default: in --out)'
    )
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Fit all recordings, and write their page."""
    options, console = arguments(argv), Console(highlight=False)
    try:
        if options.recordings < 1:
            raise ValueError(f'--recordings: expected at least 1, got {options.recordings}')
        folder = ready(options.out)
        wanted = planned(options.recordings, options.only)
        if not wanted:
            raise ValueError(f"--only: no case has '{options.only}' in its name")
        rows = _fits(wanted, folder / 'rows.jsonl', options)
        target = options.page or folder / 'tuning.md'
        target.write_text(page(rows, len(wanted)))
    except (ValueError, OSError) as error:
        refuse('tune', error)
    console.print(f'In {folder}: rows.jsonl; {target}', style='dim')
    console.print(f'{len(rows)} of {len(wanted)} recordings fitted')


def _fits(
    wanted: Sequence[tuple[Case, int]], file: Path, options: argparse.Namespace
) -> list[Row]:
    """Return the row of every recording; each is written to ``file`` once it is known.

    After an interruption, those that are there.
    """
    rows = list(_read(file)) if options.resume and file.exists() else []
    known = {(row.case, row.seed) for row in rows}
    left = [each for each in wanted if (each[0].name, each[1]) not in known]
    with file.open('a' if options.resume else 'w') as out:
        found = spread(lambda k: fitted(*left[k]), range(len(left)), options.workers)
        try:
            for _, row in track(found, 'fitting', total=len(left)):
                rows.append(row)
                out.write(json.dumps(asdict(row)) + '\n')
                out.flush()
        except KeyboardInterrupt:
            if not rows:
                raise
    names = {(case.name, seed) for case, seed in wanted}
    return [row for row in rows if (row.case, row.seed) in names]


def _read(file: Path) -> Iterator[Row]:
    for line in file.read_text().splitlines():
        entry = json.loads(line)
        estimates = [Estimate(**each) for each in entry.pop('estimates')]
        yield Row(**entry, estimates=estimates)
