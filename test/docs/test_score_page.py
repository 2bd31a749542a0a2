# SPDX-License-Identifier: Apache-2.0
"""The score of the diagnosis, as its page has it, is as good as it has to be."""

import re
from collections import defaultdict
from pathlib import Path

PAGE = (Path(__file__).parents[2] / 'docs' / 'explanation' / 'doctor.md').read_text()


def rows(section):
    """Return the cells of the table of a section, without its head."""
    part = PAGE.split(f'## {section}\n')[1].split('\n## ')[0]
    lines = [line for line in part.splitlines() if line.startswith('|')]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines[2:]]


def ranks(cell):
    """Return ranks, infinite for what was not found."""
    return [float(each) if each.isdigit() else float('inf') for each in re.findall(r'\d+|-', cell)]


def by_kind():
    """Return the ranks of each kind of fault, one a recording."""
    found = defaultdict(list)
    for fault, _, rank, _ in rows('One fault'):
        found[fault] += ranks(rank)
    return found


def test_eighteen_of_twenty_kinds_come_first_and_all_among_the_first_three():
    kinds = by_kind()
    assert len(kinds) >= 20
    assert sum(max(each) == 1 for each in kinds.values()) >= 0.9 * len(kinds)
    assert max(map(max, kinds.values())) <= 3


def test_most_pairs_are_both_among_the_first_four():
    pairs = [ranks(rank) for _, _, rank, _ in rows('Two faults')]
    assert sum(max(each) <= 4 for each in pairs) > 0.5 * len(pairs) > 0


def test_at_most_one_clean_recording_of_a_hundred_has_a_finding():
    count, alarms = map(int, re.search(r'(\d+) recordings, (\d+) with a finding', PAGE).groups())
    assert count >= 100
    assert alarms <= count / 100


def test_the_summary_counts_the_rows():
    kinds, short = by_kind(), dict(map(tuple, rows('In short')))
    assert int(short['kinds of faults']) == len(kinds)
    first = sum(max(each) == 1 for each in kinds.values())
    assert int(short['the right cause first in every scenario']) == first
    three = sum(max(each) <= 3 for each in kinds.values())
    assert int(short['the right cause among the first three in every scenario']) == three
    assert int(short['recordings with one fault']) == sum(map(len, kinds.values()))
    right = sum(each.count(1) for each in kinds.values())
    assert int(short['with the right cause first']) == right
