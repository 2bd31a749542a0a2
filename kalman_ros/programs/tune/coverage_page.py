# SPDX-License-Identifier: Apache-2.0
"""The coverage of the intervals as a page of the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .coverage_cases import COVERED, HIDDEN, IDENTIFIED, Case

if TYPE_CHECKING:
    from .coverage import Estimate, Row

_HEAD = """# How often the intervals of a fit are right

Made by `./dev tune --coverage --page docs/explanation/tuning.md`: simulated recordings, each with
another seed, fitted from wrong starts. Of 200, 95 % intervals that are right cover the truth in
92 to 98 %, unless by chance; a share outside is marked `*`. Errors are relative.
"""


def page(rows: Sequence[Row], planned: int) -> str:
    """Return the page of the fitted recordings, of which ``planned`` were wanted."""
    return ''.join(f'{line}\n' for line in _lines(rows, planned))


def _lines(rows: Sequence[Row], planned: int) -> Iterator[str]:
    yield _HEAD
    if len(rows) < planned:
        yield f'The run was interrupted: {len(rows)} of {planned} recordings are in it.\n'
    for case in COVERED:
        found = [row for row in rows if row.case == case.name]
        if found:
            yield from _covered(case, found)
    yield from _identified(rows)
    yield from _hidden(rows)


def _covered(case: Case, rows: Sequence[Row]) -> Iterator[str]:
    yield f'## {case.name.capitalize()}\n'
    spent = float(np.median([row.seconds for row in rows]))
    stopped = sum(not row.converged for row in rows)
    yield (
        f'{len(rows)} recordings of {case.seconds:g} s; a fit takes {spent:.1f} s of processor '
        f'time, {stopped or "none"} did not converge.\n'
    )
    yield '| parameter | true | determined | covered | median error | largest |'
    yield '|---|--:|--:|--:|--:|--:|'
    for name, each in _by_name(rows).items():
        known = [one for one in each if not one.reason]
        share = np.mean([one.covers for one in known]) if known else np.nan
        mark = '' if 0.92 <= share <= 0.98 else ' *'
        yield (
            f'| {_short(name)} | {each[0].true:g} | {len(known)} | {100.0 * share:.1f} %{mark} '
            f'| {_errors(known)} |'
        )
    yield ''


def _identified(rows: Sequence[Row]) -> Iterator[str]:
    cases = {case.name for case in IDENTIFIED}
    found = [row for row in rows if row.case in cases]
    if not found:
        return
    yield '## After a minute\n'
    yield '| case | parameter | true | recordings | median error | largest |'
    yield '|---|---|--:|--:|--:|--:|'
    for case in dict.fromkeys(row.case for row in found):
        for name, each in _by_name([row for row in found if row.case == case]).items():
            head = f'| {case.partition(",")[0]} | {_short(name)} | {each[0].true:g} '
            yield f'{head}| {len(each)} | {_errors(each)} |'
    yield ''


def _hidden(rows: Sequence[Row]) -> Iterator[str]:
    lines = []
    for case in HIDDEN:
        found = _by_name([row for row in rows if row.case == case.name])
        for name, each in found.items():
            open_ones = sum(bool(one.reason) for one in each)
            wanted = len(each) if name in case.hidden else 0
            mark = '' if open_ones == wanted else ' *'
            reason = next((one.reason for one in each if one.reason), '')
            lines.append(
                f'| {case.name} | {_short(name)} | {open_ones} of {len(each)}{mark} | {reason} |'
            )
    if lines:
        yield '## Parameters that a recording cannot determine\n'
        yield 'A spring that nobody pushes, a cart-pole of which every mass and length is fitted,'
        yield 'and two gyroscopes that both have a bias. A `*` marks a count that is wrong.\n'
        yield '| case | parameter | called not determined | because |\n|---|---|--:|---|'
        yield from lines


def _by_name(rows: Sequence[Row]) -> dict[str, list[Estimate]]:
    found: dict[str, list[Estimate]] = {}
    for row in rows:
        for each in row.estimates:
            found.setdefault(each.name, []).append(each)
    return found


def _errors(found: Sequence[Estimate]) -> str:
    if not found:
        return '| '
    errors = [each.error for each in found]
    return f'{100.0 * float(np.median(errors)):.2g} % | {100.0 * max(errors):.2g} %'


def _short(name: str) -> str:
    return f'`{name.removeprefix("model_parameters.")}`'
