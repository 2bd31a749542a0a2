# SPDX-License-Identifier: Apache-2.0
"""Parameter files of the pages, whole or laid over others, are what the estimator takes."""

import re
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import kalman_ros as kr
from kalman_ros.estimators import FILTERS
from kalman_ros.pipeline.reading_reader import ReadingReader
from kalman_ros.pipeline.settings import settings
from kalman_ros.programs.from_robot_localization.program import main as from_robot_localization
from kalman_ros.scenario.parameter_files import from_file

ROOT = Path(__file__).parents[2]
PAGES = ROOT / 'docs' / 'how_to'
_BLOCK = re.compile(r'```yaml\n(.*?)```', re.DOTALL)
#: The first line of a block that is laid over another file.
_OVER = re.compile(r'# over ([^\s,]+)')
BLOCKS = [
    pytest.param(block, id=f'{page.stem}-{number}')
    for page in sorted([ROOT / 'README.md', *(ROOT / 'docs').rglob('*.md')])
    for number, block in enumerate(_BLOCK.findall(page.read_text()))
]
#: What robot_localization's own test of that robot has.
JACKAL = """\
ekf_se_node:
  ros__parameters:
    odom0: /jackal_velocity_controller/odom
    odom0_config: [false, false, false, false, false, false, true, true, true,
                   false, false, false, false, false, false]
    imu0: /imu/data
    imu0_config: [false, false, false, true, true, true, false, false, false,
                  false, false, false, false, false, false]
    publish_tf: false
"""


def under(block, folder):
    """Return the parameters that a block of a page is laid over, as its first line says."""
    over = _OVER.match(block)
    if over is None:
        return {}
    if over[1].startswith('config/'):
        return from_file(ROOT / over[1], 'estimator')
    if over[1] == 'the':
        (whole,) = _BLOCK.findall((ROOT / 'README.md').read_text())
        return read(whole, folder / 'whole.yaml')
    assert over[1] == 'robot.yaml'
    theirs, ours = folder / 'theirs.yaml', folder / 'robot.yaml'
    theirs.write_text(JACKAL)
    from_robot_localization([str(theirs), '--out', str(ours)])
    return from_file(ours, 'estimator')


def read(block, file):
    if block.endswith('time_unit: years\n'):  # of the program, not of a node
        return {}
    file.write_text(block.replace('/**/estimator_map:', '/**:'))
    return from_file(file, 'estimator')


def test_there_are_some():
    assert len(BLOCKS) >= 15


@pytest.mark.parametrize('block', BLOCKS)
def test_a_block_is_a_file_or_is_laid_over_one_that_it_names(block, tmp_path, monkeypatch):
    """Whoever pastes it into a file has what the estimator takes."""
    monkeypatch.syspath_prepend(str(ROOT / 'test' / 'packages' / 'pendulum_robot'))
    given = {**under(block, tmp_path), **read(block, tmp_path / 'block.yaml')}
    found = settings(given)
    found.estimator()
    for source in found.scenario.enabled.values():
        ReadingReader(source.signal)


def test_programs_take_a_parameter_file_by_its_option():
    """A path alone would be refused."""
    commands = [
        line.strip()
        for page in PAGES.glob('*.md')
        for line in page.read_text().splitlines()
        if line.strip().startswith(('./dev replay', './dev tune', './dev doctor'))
    ]
    assert commands
    for command in commands:
        before, _, _ = command.partition('--params-file')
        assert '.yaml' not in before, command


def test_every_filter_is_on_the_page_and_in_the_docstring_that_list_them():
    page = (PAGES / 'drive.md').read_text()
    for name in FILTERS:
        assert f'`{name}`' in page
        assert f"``'{name}'``" in kr.filter.__doc__


def test_a_table_becomes_a_bag_that_is_replayed(tmp_path, monkeypatch, capsys):
    """By the code and the file of the page."""
    pytest.importorskip('rosbags.rosbag2')
    page = (PAGES / 'log_files.md').read_text()
    (code,), (block,) = re.findall(r'```python\n(.*?)```', page, re.DOTALL), _BLOCK.findall(page)
    rows = [f'{1.0 + 0.1 * k:.1f},{0.1 * k:.2f},0,1,' + ('0' if k % 2 else '') for k in range(40)]
    monkeypatch.chdir(tmp_path)
    Path('log.csv').write_text('\n'.join(['t,x,y,v,omega', *rows, '']))
    Path('robot.yaml').write_text(block)
    exec(compile(code, 'page', 'exec'), {})
    assert 'monday' in capsys.readouterr().out
    run = kr.replay('monday', 'robot.yaml')
    assert {name: each.fused for name, each in run.sensors.items()} == {'place': 40, 'wheels': 20}
    assert run.beliefs.mean[-1, 0] == pytest.approx(3.9, abs=0.2)
    assert run.beliefs.time[-1] == pytest.approx(3.9)
