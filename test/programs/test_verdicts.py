# SPDX-License-Identifier: Apache-2.0
"""Verdicts say PASS or FAIL with a count; what could not be judged gets none."""

import json
import sys
from math import nan
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip('rclpy')

from kalman_ros import scenario
from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.verdict import least_duration
from kalman_ros.harness import NodeError
from kalman_ros.programs import demo
from kalman_ros.programs.study import Findings, close
from kalman_ros.programs.study import program as study
from kalman_ros.report.run_tables import verdict
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.parameter_files import from_file

CONFIGS = sorted((Path(__file__).parents[2] / 'config').glob('*.yaml'))
GOOD, BAD = close('a', '', 1.0, 1.0, 0.1), close('b', '', 1.0, 2.0, 0.1)
POLE = Check('pole', '1/s', -1.0, -1.0, nan, nan, passed=False)


def test_a_verdict_counts_the_checks_that_have_bounds():
    assert verdict([GOOD, POLE], 'It holds.') == '[green]PASS, 1 of 1 checks:[/] It holds.'
    failed = verdict([GOOD, BAD, POLE], 'It holds.')
    assert 'FAIL, 1 of 2 checks hold:[/] theory and measurement disagree on b' in failed


def test_a_demo_that_is_incomplete_has_no_verdict(monkeypatch, tmp_path, capsys):
    def incomplete(*_):
        raise NodeError('the record is incomplete: /estimate 477 of 601 messages')

    monkeypatch.setattr(demo, 'perform', incomplete)
    with pytest.raises(SystemExit) as ended:
        demo.main(['level', '--out', str(tmp_path)])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.err == ('demo: the record is incomplete: /estimate 477 of 601 messages\n')
    assert 'PASS' not in printed.out
    assert 'FAIL' not in printed.out


@pytest.fixture
def studies(monkeypatch):
    """Have three studies: one that passes, one that cannot be run, one that fails."""

    def broken(_):
        raise NodeError('the estimator died')

    draw = Path.touch
    found = {
        'good': lambda _: Findings([GOOD], draw),
        'broken': broken,
        'bad': lambda _: Findings([GOOD, BAD], draw),
    }
    for name, run in found.items():
        module = ModuleType(name, f'About {name}.')
        module.study = run
        monkeypatch.setitem(sys.modules, f'kalman_ros.programs.study.{name}', module)
    monkeypatch.setattr(study, 'STUDIES', tuple(found))


def test_studies_go_on_after_one_that_fails_and_end_with_a_table(studies, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        study.main(['all', '--out', str(tmp_path)])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert 'study: broken: the estimator died' in printed.err
    *_, good, broken, bad, total = [line.split() for line in printed.out.strip().splitlines()]
    assert good == ['good', 'PASS', '1', 'of', '1']
    assert broken == ['broken', 'no', 'verdict', '0', 'of', '0']
    assert bad == ['bad', 'FAIL', '1', 'of', '2']
    assert total == ['FAIL,', '1', 'of', '3', 'studies']
    assert not json.loads((tmp_path / 'bad' / 'summary.json').read_text())['passed']


def test_a_study_gets_its_size(studies, tmp_path, monkeypatch):
    sizes = []
    good = sys.modules['kalman_ros.programs.study.good']
    monkeypatch.setattr(
        good, 'study', lambda size: sizes.append(size) or Findings([GOOD], Path.touch)
    )
    for given in ([], ['--size', '0.3']):
        with pytest.raises(SystemExit):
            study.main(['good', '--out', str(tmp_path), *given])
    assert sizes == [1.0, 0.3]


@pytest.mark.parametrize(('name', 'code'), [('good', 0), ('bad', 1), ('broken', 2)])
def test_the_exit_code_is_that_of_the_worst_study(studies, tmp_path, name, code):
    with pytest.raises(SystemExit) as ended:
        study.main([name, '--out', str(tmp_path)])
    assert (ended.value.code or 0) == code


@pytest.mark.parametrize('path', CONFIGS, ids=lambda path: path.stem)
def test_every_scenario_has_a_duration_that_can_be_judged(path):
    own = demo_section(path)
    built = scenario.build({**from_file(path), **own.parameters})
    assert own.duration >= least_duration(built)
    assert set(own.parameters) <= set(scenario.options(from_file(path)))
