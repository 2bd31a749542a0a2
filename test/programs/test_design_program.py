# SPDX-License-Identifier: Apache-2.0
"""``design``: the worst case and the matrices on the terminal."""

from __future__ import annotations

import pytest

from kalman_ros.programs import design


@pytest.mark.slow
def test_worst_case_is_printed(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    design.main(['mass_spring_damper', '--within', 'mass=0.8..1.25', '--out', str(tmp_path)])
    text = capsys.readouterr().out
    assert 'Worst case over mass 0.8 to 1.25' in text
    assert 'Structured singular value' in text
    assert all(len(line) <= 80 for line in text.splitlines())


@pytest.mark.slow
def test_matrices_are_printed_only_where_they_are_wanted(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    titles = 'A of dx/dt', 'B of dx/dt', 'C of y', "F of x'", "G of x'", 'Q, process', 'R, noise'
    for given in ([], ['--matrices']):
        design.main(['mass_spring_damper', '--out', str(tmp_path), *given])
        text = capsys.readouterr().out
        assert [title in text for title in titles] == len(titles) * [bool(given)]


@pytest.mark.parametrize(
    ('within', 'message'),
    [
        ('mass', "--within: expected NAME=LOW..HIGH, got 'mass'"),
        ('mass=1', 'within: expected'),
        ('mass=a..b', 'within: expected'),
        ('mass=1..2..3', 'within: expected'),
        ('mass=0.5..2 mass=1..3', '--within: expected one of mass, got two'),
        ('mas=0.5..2', "unknown parameter 'mas'; did you mean 'mass'"),
        ('mass=2..3', 'expected low < high about its designed value 1'),
    ],
)
def test_wrong_interval_is_one_line(within, message, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as error:
        given = [word for text in within.split() for word in ('--within', text)]
        design.main(['mass_spring_damper', *given, '--out', str(tmp_path)])
    assert error.value.code == 2
    text = capsys.readouterr().err
    assert message in text
    assert len(text.splitlines()) == 1
