# SPDX-License-Identifier: Apache-2.0
"""Injects every known fault into recordings and counts how often the diagnosis is right."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import track

from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.programs.refusal import refuse
from kalman_ros.programs.results import ready

from .cases import SCENARIOS, Case, cases, pairs
from .recordings import recorded
from .score_page import page

#: How many findings are kept of each recording.
_KEPT = 5


@dataclass(frozen=True)
class Row:
    """What was found in one recording.

    Parameters
    ----------
    fault, scenario
        What was injected, and where; 'none' for a clean recording.
    ranks
        Where each injected cause was found, from 1 on; 0 if it was not.
    tied
        Whether the first was found only as what fits as well as the first.
    found
        The findings, as kind and subject, ranked.
    seconds
        Of CPU that the diagnosis took.
    """

    fault: str
    scenario: str
    ranks: list[int]
    tied: bool
    found: list[str]
    seconds: float


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog='doctor --score', description=__doc__)
    parser.add_argument(
        '--seconds', type=float, default=60.0, metavar='S',
        help='length of each recording (default: %(default)g)',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=1, help='of all noise (default: %(default)d)')
    parser.add_argument(
        '--clean',
        type=int,
        default=100,
        metavar='N',
        help='clean recordings (default: %(default)d)',
    )
    parser.add_argument('--only', default='', metavar='TEXT', help='faults with it in their name')
    parser.add_argument(
        '--jobs', type=int, default=2, metavar='N', help='processes (default: %(default)d)'
    )
    parser.add_argument(
        '--resume', action='store_true', help='keep the recordings that were scored before'
    )
    parser.add_argument('--out', type=Path, default=Path('out/doctor'), metavar='DIR')
    parser.add_argument(
        '--page', type=Path, metavar='FILE', help='where doctor.md goes (default: in --out)'
    )
    return parser.parse_args(argv)


def row(fault: str, wanted: Sequence[Case], seconds: float, seed: int) -> Row:
    """Return what is found in a recording with these faults."""
    scenario = wanted[0].scenario
    injection = wanted[0].injection
    for other in wanted[1:]:
        injection = injection + other.injection
    evidence = recorded(scenario, injection, seconds, seed)
    begin = time.process_time()
    findings = diagnose(evidence).findings
    spent = time.process_time() - begin
    ranks, tied = [], False
    for case in wanted:
        rank = next((i for i, f in enumerate(findings, 1) if names(f, case)), 0)
        also = next((i for i, f in enumerate(findings, 1) if ties(f, case)), 0)
        if also and (not rank or also < rank):
            rank, tied = also, True
        ranks.append(rank)
    found = [f'{f.kind} of {f.subject}' for f in findings[:_KEPT]]
    return Row(fault, scenario, ranks, tied, found, spent)


def names(finding: Finding, case: Case) -> bool:
    """Return whether a finding names the cause of a case."""
    return finding.kind in case.kinds and finding.subject.startswith(case.subject)


def ties(finding: Finding, case: Case) -> bool:
    """Return whether a finding names the cause of a case as one that fits as well."""
    return any(k in case.kinds and s.startswith(case.subject) for k, s in finding.same_as)


def clean(scenario: str, seconds: float, seed: int) -> Row:
    """Return what is found in a recording without a fault."""
    evidence = recorded(scenario, None, seconds, seed)
    begin = time.process_time()
    findings = diagnose(evidence).findings
    found = [f'{f.kind} of {f.subject}' for f in findings[:_KEPT]]
    return Row('none', scenario, [], False, found, time.process_time() - begin)


def single(number: int, seconds: float, seed: int) -> Row:
    """Return what is found in a recording with a fault, by its number."""
    case = cases()[number]
    return row(case.fault, [case], seconds, seed)


def double(number: int, seconds: float, seed: int) -> Row:
    """Return what is found in a recording with a pair of faults, by its number."""
    both = pairs()[number]
    return row(_named(both), both, seconds, seed)


def _named(both: Sequence[Case]) -> str:
    return ' and '.join(case.fault for case in both)


#: The name of a fault, that of its row, and how the row is computed by another process.
Work = tuple[str, str, Callable[..., Row], tuple[object, ...]]


def work(options: argparse.Namespace) -> list[Work]:
    """Return every recording to score: a name, how, and with what."""
    found: list[Work] = []
    for number, case in enumerate(cases()):
        seed = options.seed + number
        key = f'{case.fault} {case.scenario} {number}'
        found.append((case.fault, key, single, (number, options.seconds, seed)))
    for number, both in enumerate(pairs()):
        fault = _named(both)
        key = f'{fault} {both[0].scenario}'
        seed = options.seed + 1000 + number
        found.append((fault, key, double, (number, options.seconds, seed)))
    for number in range(options.clean):
        scenario = SCENARIOS[number % len(SCENARIOS)]
        seed = options.seed + 2000 + number
        found.append(('none', f'none {number}', clean, (scenario, options.seconds, seed)))
    return [each for each in found if options.only in each[0]]


def main(argv: Sequence[str] | None = None) -> None:
    """Score the diagnosis and write its page."""
    options = arguments(argv)
    console = Console(highlight=False)
    try:
        folder = ready(options.out)
        rows = scored(work(options), folder / 'rows.jsonl', options)
        target = options.page or folder / 'doctor.md'
        target.write_text(page(rows, options.seconds, options.seed))
    except (ValueError, OSError) as error:
        refuse('doctor', error)
    single = [each for each in rows if len(each.ranks) == 1]
    first = sum(each.ranks == [1] for each in single)
    alarms = sum(bool(each.found) for each in rows if not each.ranks)
    console.print(f'In {folder}: rows.jsonl; {target}', style='dim')
    console.print(f'{first} of {len(single)} causes first; {alarms} false alarms')


def scored(planned: Sequence[Work], file: Path, options: argparse.Namespace) -> list[Row]:
    """Return the row of every recording; each is written to ``file`` once it is known."""
    known: dict[str, Row] = {}
    if options.resume and file.exists():
        for line in file.read_text().splitlines():
            entry = json.loads(line)
            key = entry.pop('key')
            known[key] = Row(**entry)
    left = [each for each in planned if each[1] not in known]
    with file.open('a' if options.resume else 'w') as out:
        for key, found in _parallel(left, options.jobs):
            known[key] = found
            out.write(json.dumps({'key': key, **asdict(found)}) + '\n')
            out.flush()
    return [known[key] for _, key, _, _ in planned]


def _parallel(planned: Sequence[Work], jobs: int) -> Iterable[tuple[str, Row]]:
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(how, *given): key for _, key, how, given in planned}
        for done in track(as_completed(waiting), 'scoring', total=len(waiting)):
            yield waiting[done], done.result()


if __name__ == '__main__':
    main()
