# SPDX-License-Identifier: Apache-2.0
"""`tune --coverage`: simulated recordings, what is found in them, and the page."""

from dataclasses import replace

import pytest

from kalman_ros.programs.tune import coverage, program
from kalman_ros.programs.tune.coverage import Estimate, Row, fitted
from kalman_ros.programs.tune.coverage_cases import COVERED, HIDDEN
from kalman_ros.programs.tune.coverage_page import page


@pytest.mark.slow
@pytest.mark.parametrize('case', HIDDEN, ids=[case.name for case in HIDDEN])
def test_parameters_that_cannot_be_determined_are_called_so(case):
    row = fitted(case, 1)
    assert {each.name for each in row.estimates if each.reason} == {*case.hidden}


@pytest.mark.slow
def test_a_delay_is_found_within_a_tenth_of_a_period():
    row = fitted(COVERED[0], 1)
    found = {each.name: each for each in row.estimates}
    assert row.converged and found['position.delay'].true == 0.012
    assert abs(found['position.delay'].value - 0.012) < 0.1 / 25.0
    # of six intervals of 95 %, four or fewer cover with a probability of 3 %
    assert sum(each.covers for each in found.values()) >= 5


def estimate(name, value, reason=''):
    return Estimate(name, 1.0, value, value - 0.5, value + 0.5, reason)


def test_the_page_counts_what_covers():
    name, hidden = COVERED[0].name, HIDDEN[0]
    rows = [
        Row(name, k, k != 3, 2.0, [estimate('a', 1.0 if k else 2.0), estimate('b', 1.1, 'wide')])
        for k in range(20)
    ]
    rows.append(Row(hidden.name, 0, True, 1.0, [estimate(hidden.hidden[0], 1.0)]))
    text = page(rows, 30)
    assert 'interrupted: 21 of 30 recordings' in text and '1 did not converge' in text
    assert '| `a` | 1 | 20 | 95.0 % | 0 % | 1e+02 % |' in text
    assert '| `b` | 1 | 0 | nan % * |' in text
    assert f'| {hidden.name} | `mass` | 0 of 1 * |' in text
    assert 'interrupted' not in page(rows, 21)


def test_recordings_are_kept_and_resumed(tmp_path, monkeypatch, capsys):
    asked = []

    def interrupted(task, items, workers):
        asked.append(len(items))
        yield 0, Row(COVERED[0].name, 0, True, 1.0, [estimate('a', 1.0)])
        raise KeyboardInterrupt

    monkeypatch.setattr(coverage, 'spread', interrupted)
    arguments = ['--coverage', '--recordings', '3', '--only', 'spring', '--out', str(tmp_path)]
    for _ in range(2):
        program.main([*arguments, '--resume'])
    assert asked == [5, 4]
    assert 'interrupted: 2 of 5' in (tmp_path / 'tuning.md').read_text()
    assert 'of 5 recordings fitted' in capsys.readouterr().out


@pytest.mark.parametrize(('given', 'words'), [
    (['--recordings', '0'], '--recordings: expected at least 1, got 0'),
    (['--only', 'submarine'], "no case has 'submarine' in its name"),
])  # fmt: skip
def test_a_wrong_argument_is_refused(given, words, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        program.main(['--coverage', *given, '--out', str(tmp_path)])
    assert ended.value.code == 2 and words in capsys.readouterr().err


def test_the_same_seed_gives_the_same_recording():
    case = replace(COVERED[2], seconds=1.0)
    one, same, other = (coverage.recorded(case, seed) for seed in (1, 1, 2))
    assert (one.readings['imu'] == same.readings['imu']).all()
    assert (one.readings['imu'] != other.readings['imu']).all()
    assert one.times['position'][0] == 0.06
