# SPDX-License-Identifier: Apache-2.0
"""Parameter files of the how-to pages that are whole are what the estimator takes."""

import re
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from kalman_ros.pipeline.reading_reader import ReadingReader
from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario.parameter_files import from_file

PAGES = Path(__file__).parents[2] / 'docs' / 'how_to'
BLOCKS = [
    pytest.param(block, id=f'{page.stem}-{number}')
    for page in sorted(PAGES.glob('*.md'))
    for number, block in enumerate(re.findall(r'```yaml\n(.*?)```', page.read_text(), re.DOTALL))
    if 'model:' in block and block.startswith('/**:')
]


def test_there_are_some():
    assert len(BLOCKS) >= 3


@pytest.mark.parametrize('block', BLOCKS)
def test_a_whole_file_is_one(block, tmp_path):
    file = tmp_path / 'robot.yaml'
    file.write_text(block)
    found = settings(from_file(file, 'estimator'))
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
