# SPDX-License-Identifier: Apache-2.0
"""Score of the doctor on the recordings: ``./dev strangers --score``.

The doctor runs as its users run it: its executable, with the recording and its parameter file, in
a process of its own. The JSON of each run is kept in ``NAME/doctor/result.json``; a run with this
file is not repeated. `matching` says which findings are right. If nothing shows the fault (alike
is 'clean'), no finding is right as well.

A *remark* is a finding about what the file or the messages do not declare, which is true of most
recordings, clean ones included: a rate, or a covariance of zero. Remarks count in the shares 'as
printed' only, and so do findings of what a real recording has wrong by itself. All other findings
are claims. A first claim that is wrong is *false and confident* if the doctor is sure of it by 90
percent or more.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .matching import Finding, interval, is_own, is_right, is_tied
from .scored import RECORDINGS, write

#: Kinds of findings that are remarks.
REMARKS = ('rate', 'covariance zero')
#: Certainty from which a claim is confident.
_SURE = 0.9
_RUN = 'from kalman_ros import entry; entry.doctor()'


@dataclass(frozen=True)
class Row:
    """The score of a recording.

    ``rank`` is the place of the first right claim, from 1 on, or 0; ``printed`` is its place among
    all findings. ``interval`` is 'in' or 'out' if the right claim has an interval of the size, and
    ``certainty`` is that of the first claim, 0 without one.
    """

    name: str
    kind: str
    truth: str
    findings: list[str]
    verdict: str
    rank: int
    printed: int
    tied: bool
    confident: bool
    flagged: bool
    interval: str
    seconds: float
    certainty: float


def judge(name: str, run: Mapping[str, Any]) -> Row:
    """Return the row of a recording from the JSON of a run of the doctor."""
    recording, findings = RECORDINGS[name], run['findings'] or ()
    said = [finding for finding in findings if finding['kind'] not in REMARKS]
    claims = [finding for finding in said if not is_own(finding, recording)]
    right = [is_right(f, recording) or is_tied(f, recording) for f in claims]
    rank = right.index(True) + 1 if any(right) else 0
    best = claims[rank - 1] if rank else None
    tied = best is not None and not is_right(best, recording)
    hidden = 'clean' in (recording.kind, recording.alike)
    confident = bool(claims) and rank != 1 and _sure(claims[0])
    if run['findings'] is None:
        verdict = 'failed'
    elif hidden and not rank:
        verdict = 'flagged' if claims else 'clean'
    elif not rank:
        verdict = 'wrong' if claims else 'missed'
    else:
        verdict = 'first' if rank == 1 else 'within three' if rank <= 3 else 'later'
    return Row(
        name, recording.kind, recording.truth, [_brief(f) for f in said[:3]], verdict, rank,
        findings.index(best) + 1 if best else 0, tied,
        confident, bool(findings), interval(best, recording) if best else '', run['seconds'],
        claims[0]['certainty'] if claims else 0.0,
    )  # fmt: skip


def _sure(finding: Finding) -> bool:
    return bool(finding['certainty'] >= _SURE)


def _brief(finding: Finding) -> str:
    share = f'{100 * finding["share"]:.0f} %' if finding['gain'] > 0.0 else '-'
    same = ''.join(f' or {kind} of {subject}' for kind, subject in finding['same as'])
    return f'{finding["kind"]} of {finding["subject"]} ({share}){same}'


def examine(name: str, folder: Path, limit: float) -> dict[str, Any]:
    """Run the doctor on a recording, which is written first if it is missing; keep the result."""
    out = folder / 'doctor'
    file = out / 'result.json'
    if file.exists():
        return dict(json.loads(file.read_text()))
    if not (folder / 'robot.yaml').exists():
        write(name, folder)
    out.mkdir(exist_ok=True)
    (out / 'summary.json').unlink(missing_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    given = [str(folder / 'recording.mcap'), '--params-file', str(folder / 'robot.yaml')]
    command = [sys.executable, '-c', _RUN, *given, '--out', str(out)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
        code, error = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        code, error = -1, f'no result within {limit:g} s'
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    summary = out / 'summary.json'
    findings = json.loads(summary.read_text())['findings'] if summary.exists() else None
    run = {'code': code, 'error': error, 'seconds': seconds, 'findings': findings}
    file.write_text(json.dumps(run, indent=1) + '\n')
    return run


def line(row: Row) -> str:
    """Return a row of the table: name, verdict, seconds, truth, and the first three claims."""
    marks = (row.tied and 'tied', row.confident and 'false', row.interval)
    words = ' '.join([row.verdict, *(f'({mark})' for mark in marks if mark)])
    claims = '; '.join(row.findings) or 'nothing'
    return f'{row.name:27} {words:20} {row.seconds:5.1f} s  {row.truth}  ->  {claims}'


def shares(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the shares of all recordings, and of each kind of fault."""
    hidden = [row for row in rows if 'clean' in (row.kind, RECORDINGS[row.name].alike)]
    shown = [row for row in rows if row not in hidden]

    def share(text: str, count: int, of: Sequence[Row]) -> str:
        return f'{text:38} {count:3} of {len(of):3}  {100.0 * count / max(1, len(of)):4.0f} %'

    yield share('first', sum(row.rank == 1 for row in shown), shown)
    yield share('  of these tied', sum(row.rank == 1 and row.tied for row in shown), shown)
    yield share('among three', sum(1 <= row.rank <= 3 for row in shown), shown)
    yield share('first, as printed', sum(row.printed == 1 for row in shown), shown)
    yield share('among three, as printed', sum(1 <= row.printed <= 3 for row in shown), shown)
    yield share('false and confident first', sum(row.confident for row in rows), rows)
    yield share('failed', sum(row.verdict == 'failed' for row in rows), rows)
    yield share('clean, flagged', sum(row.verdict == 'flagged' for row in hidden), hidden)
    yield share('clean, flagged, as printed', sum(row.flagged for row in hidden), hidden)
    sized = [row for row in shown if row.interval]
    yield share('interval has the size', sum(row.interval == 'in' for row in sized), sized)
    for kind in dict.fromkeys(row.kind for row in shown):
        of = [row for row in shown if row.kind == kind]
        first, three = (sum(1 <= row.rank <= last for row in of) for last in (1, 3))
        wrong = sum(row.confident for row in of)
        yield f'{share(kind, first, of)}  {three} among three, {wrong} false'


def score(names: Sequence[str], folder: Path, limit: float) -> None:
    """Print the rows and the shares of recordings, and write them to ``score.json``."""
    rows = []
    for name in names:
        rows.append(judge(name, examine(name, folder / name, limit)))
        print(line(rows[-1]), flush=True)
    print('\n' + '\n'.join(shares(rows)))
    kept = {'shares': [*shares(rows)], 'rows': [asdict(row) for row in rows]}
    (folder / 'score.json').write_text(json.dumps(kept, indent=1) + '\n')
