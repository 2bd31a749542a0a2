# SPDX-License-Identifier: Apache-2.0
"""The score of the diagnosis as a page of the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

_HEAD = """# How often the diagnosis is right

**Every recording is from our own simulation, and goes through the estimator's own replay, with its
windows, gates and outcomes, before the diagnosis looks at it, as one of `./dev doctor BAG` does.**

Made by `./dev doctor_score --page docs/explanation/doctor.md`: recordings of {seconds:g} s from
simulation, seed {seed}, with one fault each, with two, and with none. A cause counts as found if
kind and sensor (or input, or parameter) are right. *Tied* means that the first finding names
another cause and adds that this one fits the data as well: a bias of one of two sensors that
contradict each other, or a force and the bias that looks like it.

Sizes of faults were chosen so that they show. A loss of commands on the mass is left out: the
commands change by less than the noise of the force. [Recordings that were made
elsewhere](doctor_elsewhere.md) have their own page.
"""
_FIRST = """
The search is a forward selection by likelihood. What stamps and values show without a filter
(zero, duplicated or backward stamps, delays, losses, frozen values) is found first, and is
corrected. Then an extended Kalman filter passes over the readings in the order of their stamps,
and the responses of its innovations to every fault are computed in the same pass: offsets in
pieces, mixes of coordinates, inputs, parameters, the first belief (A. Willsky and H. Jones, 1976;
R. Mehra and J. Peschon, 1971), and the derivatives by every noise variance (N. Gupta and R. Mehra,
1974). The cause that reduces -2 log likelihood most is corrected, and the rest is looked at again.
"""


def page(rows: Sequence[Any], seconds: float, seed: int) -> str:
    """Return the page of a score."""
    return ''.join(f'{line}\n' for line in _lines(rows, seconds, seed))


def _lines(rows: Sequence[Any], seconds: float, seed: int) -> Iterator[str]:
    yield _HEAD.format(seconds=seconds, seed=seed)
    single = [row for row in rows if len(row.ranks) == 1]
    pairs = [row for row in rows if len(row.ranks) == 2]
    clean = [row for row in rows if not row.ranks]
    kinds = {k: list(g) for k, g in groupby(sorted(single, key=_fault), key=_fault)}
    yield '## In short\n'
    yield from _counts(kinds, single, pairs, clean)
    yield _FIRST
    yield '## One fault\n'
    yield '| fault | scenario | rank | found |\n|---|---|--:|---|'
    for row in single:
        yield f'| {row.fault} | {row.scenario} | {_rank(row)} | {_findings(row)} |'
    if pairs:
        yield '\n## Two faults\n'
        yield '| faults | scenario | ranks | found |\n|---|---|--:|---|'
        for row in pairs:
            ranks = ', '.join(str(rank) if rank else '-' for rank in row.ranks)
            yield f'| {row.fault} | {row.scenario} | {ranks} | {_findings(row)} |'
    if clean:
        yield '\n## Clean recordings\n'
        alarms = [row for row in clean if row.found]
        yield f'{len(clean)} recordings, {len(alarms)} with a finding.'
        for row in alarms:
            yield f'\n- {row.scenario}: {_findings(row)}'


def _counts(
    kinds: dict[str, list[Any]], single: Sequence[Any], pairs: Sequence[Any], clean: Sequence[Any]
) -> Iterator[str]:
    """Yield the table of counts."""
    first = [kind for kind, rows in kinds.items() if all(row.ranks[0] == 1 for row in rows)]
    most = [
        kind
        for kind, rows in kinds.items()
        if 2 * sum(row.ranks[0] == 1 for row in rows) > len(rows)
    ]
    three = [kind for kind, rows in kinds.items() if all(1 <= row.ranks[0] <= 3 for row in rows)]
    yield '| | |\n|---|--:|'
    yield f'| kinds of faults | {len(kinds)} |'
    yield f'| the right cause first in every scenario | {len(first)} |'
    yield f'| the right cause first in most scenarios | {len(most)} |'
    yield f'| the right cause among the first three in every scenario | {len(three)} |'
    yield f'| recordings with one fault | {len(single)} |'
    yield f'| with the right cause first | {sum(row.ranks == [1] for row in single)} |'
    yield f'| of these tied | {sum(row.ranks == [1] and row.tied for row in single)} |'
    if pairs:
        both = sum(all(1 <= rank <= 4 for rank in row.ranks) for row in pairs)
        yield f'| pairs with both among the first four | {both} of {len(pairs)} |'
    if clean:
        alarms = sum(bool(row.found) for row in clean)
        yield f'| clean recordings with a finding | {alarms} of {len(clean)} |'
    longest = max((row.seconds for row in (*single, *pairs, *clean)), default=0.0)
    yield f'| longest diagnosis (s of CPU) | {longest:.1f} |'


def _fault(row: Any) -> str:
    return str(row.fault)


def _rank(row: Any) -> str:
    if not row.ranks[0]:
        return '-'
    return f'{row.ranks[0]}{" (tied)" if row.tied else ""}'


def _findings(row: Any) -> str:
    return '; '.join(row.found) or 'nothing'
