# SPDX-License-Identifier: Apache-2.0
"""The score of the diagnosis, as its page has it, is as good as it has to be."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / 'docs' / 'explanation' / 'doctor.md').read_text()


def rows(section):
    """Return the cells of the table of a section, by its first column."""
    part = PAGE.split(f'## {section}\n')[1].split('\n## ')[0]
    lines = [line for line in part.splitlines() if line.startswith('|')]
    head, _, *others = [[cell.strip() for cell in line[1:-1].split('|')] for line in lines]
    return {name: dict(zip(head[1:], cells)) for name, *cells in others}


def counts(cell):
    """Return how many of how many."""
    return tuple(map(int, re.match(r'(\d+) of (\d+)', cell).groups()))


def share(*cells):
    some, all_of = map(sum, zip(*map(counts, cells)))
    return some / all_of


@pytest.mark.parametrize('name', ['ours', 'real', 'thirteenth'])
def test_the_right_cause_is_first_and_a_sure_one_is_seldom_wrong(name):
    row = rows('In short')[name]
    assert share(row['first']) > 0.9
    assert share(row['among three']) > 0.95
    assert share(row['wrong and sure']) < 0.03
    assert share(row['clean, flagged']) < 0.03


def test_on_recordings_from_elsewhere_it_reaches_its_goals():
    real, blind = (rows('In short')[name] for name in ('real', 'thirteenth'))
    assert share(real['among three'], blind['among three']) >= 0.97
    assert share(real['clean, flagged'], blind['clean, flagged']) == 0.0


def test_it_is_right_as_often_as_it_says():
    sure = rows('How sure it says that it is')
    assert share(sure['85 to 95 %']['all']) > 0.85
    assert share(sure['95 to 99 %']['all']) > 0.95
    assert 0.5 < share(sure['50 to 85 %']['all']) < 0.95


@pytest.mark.parametrize('name', ['ours', 'real', 'thirteenth'])
def test_the_summary_counts_the_rows(name):
    kinds = [row[name] for row in rows('By kind').values() if row[name]]
    assert tuple(map(sum, zip(*map(counts, kinds)))) == counts(rows('In short')[name]['first'])
