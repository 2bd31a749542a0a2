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
from .page import page
from .recordings import recorded

#: Number of findings that are kept of each recording.
_KEPT = 5


@dataclass(frozen=True)
class Row:
    """Result of the diagnosis of one recording.

    Parameters
    ----------
    fault, scenario
        Injected fault, 'none' for a clean recording, and scenario.
    ranks
        Rank of each injected cause, from 1 on; 0 if it was not found.
    tied
        Whether an injected cause was found only as one that fits the data as well.
    found
        Findings as kind and subject, ranked.
    seconds
        CPU time of the diagnosis in s.
    """

    fault: str
    scenario: str
    ranks: list[int]
    tied: bool
    found: list[str]
    seconds: float


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog='doctor_score', description=__doc__)
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


def row(fault: str, injected: Sequence[Case], seconds: float, seed: int) -> Row:
    """Return the result of a recording with the injected faults."""
    scenario = injected[0].scenario
    injection = injected[0].injection
    for other in injected[1:]:
        injection = injection + other.injection
    evidence = recorded(scenario, injection, seconds, seed)
    begin = time.process_time()
    diagnosis = diagnose(evidence)
    noted = [each for each in diagnosis.notes if any(names(each, case) for case in injected)]
    findings = (*diagnosis.findings, *noted)
    spent = time.process_time() - begin
    ranks, tied = [], False
    for case in injected:
        rank = next((i for i, f in enumerate(findings, 1) if names(f, case)), 0)
        also = next((i for i, f in enumerate(findings, 1) if ties(f, case)), 0)
        if also and (not rank or also < rank):
            rank, tied = also, True
        ranks.append(rank)
    kept = [f'{f.kind} of {f.subject}' for f in findings[:_KEPT]]
    return Row(fault, scenario, ranks, tied, kept, spent)


def names(finding: Finding, case: Case) -> bool:
    """Return whether a finding names the cause of a case."""
    return finding.kind in case.kinds and finding.subject.startswith(case.subject)


def ties(finding: Finding, case: Case) -> bool:
    """Return whether a finding names the cause of a case as one that fits as well."""
    return any(k in case.kinds and s.startswith(case.subject) for k, s in finding.same_as)


def clean(scenario: str, seconds: float, seed: int) -> Row:
    """Return the result of a recording without a fault."""
    evidence = recorded(scenario, None, seconds, seed)
    begin = time.process_time()
    findings = diagnose(evidence).findings
    kept = [f'{f.kind} of {f.subject}' for f in findings[:_KEPT]]
    return Row('none', scenario, [], False, kept, time.process_time() - begin)


def single(number: int, seconds: float, seed: int) -> Row:
    """Return the result of a recording with one fault, by the number of its case."""
    case = cases()[number]
    return row(case.fault, [case], seconds, seed)


def double(number: int, seconds: float, seed: int) -> Row:
    """Return the result of a recording with two faults, by the number of their pair."""
    both = pairs()[number]
    return row(_pair_name(both), both, seconds, seed)


def _pair_name(both: Sequence[Case]) -> str:
    return ' and '.join(case.fault for case in both)


#: Name of a fault, key of its row, and the function that computes it, with its arguments.
Work = tuple[str, str, Callable[..., Row], tuple[object, ...]]


def work(options: argparse.Namespace) -> list[Work]:
    """Return every recording to score, as work for another process."""
    planned: list[Work] = []
    for number, case in enumerate(cases()):
        seed = options.seed + number
        key = f'{case.fault} {case.scenario} {number}'
        planned.append((case.fault, key, single, (number, options.seconds, seed)))
    for number, both in enumerate(pairs()):
        fault = _pair_name(both)
        key = f'{fault} {both[0].scenario}'
        seed = options.seed + 1000 + number
        planned.append((fault, key, double, (number, options.seconds, seed)))
    for number in range(options.clean):
        scenario = SCENARIOS[number % len(SCENARIOS)]
        seed = options.seed + 2000 + number
        planned.append(('none', f'none {number}', clean, (scenario, options.seconds, seed)))
    return [item for item in planned if options.only in item[0]]


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
        refuse('doctor_score', error)
    single = [result for result in rows if len(result.ranks) == 1]
    first = sum(result.ranks == [1] for result in single)
    alarms = sum(bool(result.found) for result in rows if not result.ranks)
    console.print(f'In {folder}: rows.jsonl; {target}', style='dim')
    console.print(f'{first} of {len(single)} causes first; {alarms} false alarms')


def scored(planned: Sequence[Work], file: Path, options: argparse.Namespace) -> list[Row]:
    """Return the row of every recording; a row is written to ``file`` as soon as it is known."""
    known: dict[str, Row] = {}
    if options.resume and file.exists():
        for line in file.read_text().splitlines():
            entry = json.loads(line)
            key = entry.pop('key')
            known[key] = Row(**entry)
    left = [item for item in planned if item[1] not in known]
    with file.open('a' if options.resume else 'w') as out:
        for key, result in _parallel(left, options.jobs):
            known[key] = result
            out.write(json.dumps({'key': key, **asdict(result)}) + '\n')
            out.flush()
    return [known[key] for _, key, _, _ in planned]


def _parallel(planned: Sequence[Work], jobs: int) -> Iterable[tuple[str, Row]]:
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(how, *args): key for _, key, how, args in planned}
        for done in track(as_completed(waiting), 'scoring', total=len(waiting)):
            yield waiting[done], done.result()
