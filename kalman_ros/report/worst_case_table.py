# SPDX-License-Identifier: Apache-2.0
"""The worst case of a loop as a table and sentences."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from kalman_ros.analysis.worst_case import WorstCases
from kalman_ros.control.worst_case import Bracket
from kalman_ros.core import Array

from .sheet import Sheet


def table(worst: WorstCases) -> Sheet:
    """Return what was found and what is proved, and where."""
    rows = {'cost a second': (f'{worst.nominal_cost:.4g}', *_bracket(worst.cost))}
    for name, peak in worst.disk.items():
        margin = Bracket(_disk(peak.reached), _disk(peak.bound), peak.point)
        rows[f'disk margin, {name}'] = (f'{worst.nominal_disk[name]:.4g}', *_bracket(margin))
    titles = ('believed', 'worst', 'bound', *(f'at {name}' for name in _short(worst)))
    return Sheet(list(rows), list(zip(titles, zip(*rows.values()))))


def sentences(worst: WorstCases) -> Iterator[str]:
    """Yield the margins at the worst plant, and how far the intervals could be widened."""
    for name, margins in worst.margins.items():
        yield f'Margins at {name} there: {margins or "unstable"}.'
    limit = worst.stability
    known = f', not with {limit.refuted:.4g} times as wide ones' if limit.refuted < inf else ''
    yield f'Stable with intervals {limit.proved:.4g} times as wide{known}.'
    if limit.point is not None:
        yield f'There it is unstable at {_place(worst, limit.point)}.'
    low, high = limit.structured_singular_value
    yield f'Structured singular value of these parameters: {low:.4g} to {high:.4g}.'


def over(worst: WorstCases) -> str:
    """Return the intervals as text."""
    ends = zip(_short(worst), worst.low, worst.high)
    return ', '.join(f'{name} {low:g} to {high:g}' for name, low, high in ends)


def _bracket(bracket: Bracket) -> tuple[str, ...]:
    places = (f'{value:.4g}' for value in bracket.point.tolist())
    bound = f'{bracket.bound:.4g}' if bracket.bound not in (0.0, inf) else 'none'
    return f'{bracket.reached:.4g}', bound, *places


def _disk(peak: float) -> float:
    return 2.0 / max(peak, 1.0)


def _short(worst: WorstCases) -> list[str]:
    return [name.rpartition('.')[2] for name in worst.names]


def _place(worst: WorstCases, point: Array) -> str:
    values = zip(_short(worst), point.tolist())
    return ', '.join(f'{name} {value:.4g}' for name, value in values)
