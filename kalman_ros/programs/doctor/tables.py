# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as a table and sentences for the terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

from rich.table import Table

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.diagnosis.diagnose import Diagnosis
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.report.run_tables import plain, plain_table
from kalman_ros.scenario.parameter_text import yaml_value

#: How many findings of a first look are named.
_FIRST = 3


def findings_table(diagnosis: Diagnosis) -> Table:
    """Return the ranked findings: kind, subject, certainty, share of the misfit explained."""
    table = plain_table('', ('of', 'sure', 'explains', 'misfit', 'by replay'), 2)
    for number, finding in enumerate(diagnosis.findings, start=1):
        explains = f'{100.0 * finding.share:.0f} %' if finding.gain > 0.0 else '-'
        gain = f'-{finding.gain:.4g}' if finding.gain > 0.0 else '-'
        proof = f'{-finding.proof:.4g}' if isfinite(finding.proof) else '-'
        sure = f'{min(99.0, 100.0 * finding.certainty):.0f} %'
        table.add_row(f'{number} {finding.kind}', finding.subject, sure, explains, gain, proof)
    return table


def first_sight(diagnosis: Diagnosis, begin: float, end: float) -> str:
    """Return what a part of a recording shows, from ``begin`` to ``end`` (s), as a sentence."""
    findings = [
        f'{finding.kind} of {finding.subject}'
        + (f' ({100.0 * finding.certainty:.0f} %)' if finding.gain > 0.0 else '')
        for finding in diagnosis.findings[:_FIRST]
    ]
    said = ', '.join(findings) or 'nothing is wrong'
    return f'At first sight, from t = {begin:.3g} to {end:.3g} s: {said}.'


def sentences(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield each finding as sentences, and the lines of YAML to change."""
    for number, finding in enumerate(diagnosis.findings, start=1):
        yield f'{number}. {capital(finding.sentence)}'
        for kind, subject in dict.fromkeys(finding.same_as):
            yield f'   These data fit as well: {kind} of {subject}.'
        for name, value in finding.change.items():
            yield f'   {name}: {"(removed)" if value is None else yaml_value(value)}'
    for note in diagnosis.notes:
        yield f'Note: {note.sentence}'


def capital(sentence: str) -> str:
    """Return a sentence that begins with a capital letter."""
    return sentence[:1].upper() + sentence[1:]


def unexplained(failed: Sequence[Check]) -> Iterator[str]:
    """Yield a note on the checks that fail in a replay, although nothing was found."""
    words = ', '.join(
        f'{check.name} is {check.measured.real:.3g} ({check.low:.3g} to {check.high:.3g})'
        for check in failed
    )
    if words:
        yield f'Note: a replay fails: {words}. No cause explains enough of it to be named.'


def verdict(diagnosis: Diagnosis, failed: Sequence[Check] = ()) -> str:
    """Return the verdict: PASS without findings, FAIL with their number."""
    count = len(diagnosis.findings)
    if not count and failed:
        return '[green]PASS, 0 findings:[/] but a replay fails, for no cause that is named here.'
    if not count:
        return '[green]PASS, 0 findings:[/] readings and parameters agree.'
    first = diagnosis.findings[0]
    plural = '' if count == 1 else 's'
    return f'[bold red]FAIL, {count} finding{plural}:[/] first {first.kind} of {first.subject}'


def summary(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis for ``summary.json``."""
    return {
        'misfit': diagnosis.before,
        'misfit with all corrected': diagnosis.after,
        'findings': [_finding_json(finding) for finding in diagnosis.findings],
        'notes': [_finding_json(note) for note in diagnosis.notes],
    }


def _finding_json(finding: Finding) -> dict[str, Any]:
    return {
        'kind': finding.kind,
        'subject': finding.subject,
        'sentence': finding.sentence,
        'z': plain(float(finding.z)),
        'change': dict(finding.change),
        'gain': float(finding.gain),
        'share': float(finding.share),
        'certainty': float(finding.certainty),
        'proof': plain(float(finding.proof)),
        'same as': [list(other) for other in finding.same_as],
    }
