# SPDX-License-Identifier: Apache-2.0
"""What a page shows as printed is what is printed, at 80 columns."""

import re
from pathlib import Path

import pytest
from rich.console import Console

import kalman_ros as kr
from kalman_ros.analysis.verdict import judge
from kalman_ros.programs import design
from kalman_ros.report.run_tables import checks_table

DOCS = Path(__file__).parents[2] / 'docs'


def shown(page, first):
    """Return the lines of the block that begins with a text."""
    blocks = re.findall(r'^```(\w*)\n(.*?)^```$', (DOCS / page).read_text(), re.M | re.S)
    (block,) = (text for kind, text in blocks if not kind and text.startswith(first))
    return [line.rstrip() for line in block.splitlines() if line.strip()]


def contains(printed, lines):
    there = [line.rstrip() for line in printed.splitlines()]
    position = 0
    for line in lines:
        assert line in there[position:], f'not printed: {line}\n{printed}'
        position = there.index(line, position) + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ('page', 'first', 'argv'),
    [
        ('how_to/design.md', 'Standard deviations', ['cart_pole']),
        (
            'how_to/robust.md', 'Worst case over pole_mass',
            ['cart_pole', '--within', 'pole_mass=0.15..0.25', '--within', 'length=0.25..0.35'],
        ),
    ],
)  # fmt: skip
def test_a_design_is_printed_as_shown(page, first, argv, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.chdir(tmp_path)
    try:
        design.main(argv)
    except SystemExit as end:
        assert not end.code
    contains(capsys.readouterr().out, shown(page, first))


@pytest.mark.slow
def test_the_first_demo_is_printed_as_shown():
    # the nodes in lockstep have the same numbers
    run = kr.simulate('mass_spring_damper_2d', seconds=60, seed=0)
    console = Console(width=80)
    with console.capture() as printed:
        console.print(checks_table('', judge(run.scenario, run).checks))
    columns = ' '.join(printed.get().split())
    for line in shown('tutorials/first_loop.md', 'mass_spring')[3:]:
        assert ' '.join(line.split()) in columns, line
