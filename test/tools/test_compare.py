# SPDX-License-Identifier: Apache-2.0
"""The comparison of filters as a person runs it, on few runs."""

import json

import pytest
from tools.compare import program as compare


@pytest.mark.slow
def test_it_prints_a_table_and_writes_its_results(tmp_path, capsys):
    arguments = ['range_bearing', '--runs', '3', '--out', str(tmp_path / 'out')]
    compare.main(arguments)
    printed = capsys.readouterr().out
    assert 'range and bearing [m]' in printed
    assert printed.count(' ekf  ') == 3
    results = json.loads((tmp_path / 'out' / 'summary.json').read_text())['results']
    assert [found['filter'] for found in results] == ['ekf', 'ukf'] * 3
    assert {found['runs'] for found in results} == {3}
    assert all(found['microseconds_per_step'] > 1.0 for found in results)
    assert (tmp_path / 'out' / 'errors.png').stat().st_size > 10_000


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['range_bearin'], "unknown case 'range_bearin'; did you mean 'range_bearing'?"),
        (['--filters', 'efk'], "unknown filter 'efk'; did you mean"),
        (['--runs', '0'], 'runs: expected at least 1, got 0'),
        (['pole', '--filters', 'kf'], 'filter: kf needs a linear model'),
    ],
)
def test_it_says_what_is_wrong(arguments, says, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        compare.main([*arguments, '--out', str(tmp_path)])
    assert ended.value.code == 2
    assert f'compare: {says}' in capsys.readouterr().err
