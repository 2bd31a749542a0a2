# SPDX-License-Identifier: Apache-2.0
"""What the tutorials show in Python runs, page by page, and the front page stays short."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # each starts a process

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / 'docs' / 'tutorials'
#: Pages that start nodes.
WITH_NODES = ('test_scripts',)
PAGES = [
    pytest.param(page.stem, marks=[pytest.mark.thorough] if page.stem in WITH_NODES else [])
    for page in sorted(TUTORIALS.glob('*.md'))
    if '```python' in page.read_text()
]


def code_of(page):
    """Return the Python of a page, its blocks one after the other."""
    return '\n'.join(re.findall(r'^```python\n(.*?)^```', page.read_text(), re.M | re.S))


@pytest.mark.parametrize('name', PAGES)
def test_the_code_of_a_tutorial_runs(name, tmp_path):
    if name in WITH_NODES:
        pytest.importorskip('rclpy')
    program = tmp_path / 'page.py'
    program.write_text(code_of(TUTORIALS / f'{name}.md'))
    result = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=110, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout


def test_the_code_of_the_front_page_runs(tmp_path):
    blocks = re.findall(r'^```python\n(.*?)^```', (ROOT / 'README.md').read_text(), re.M | re.S)
    program = tmp_path / 'readme.py'
    shown = next(block for block in blocks if 'import kalman_ros as kr' in block)
    program.write_text(f"import matplotlib\nmatplotlib.use('Agg')\n{shown}")
    result = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=110, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr


def test_the_front_page_is_short():
    assert len((ROOT / 'README.md').read_text().split()) <= 900
