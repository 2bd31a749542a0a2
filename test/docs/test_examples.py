# SPDX-License-Identifier: Apache-2.0
"""The examples of docs/examples run, print their claims, and are a page long."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples'
SAYS = {
    'arrays': ['rejected: outside the gate', 'FAIL: 1 of 2 checks passed', 'filtered: RMS error'],
    'design': ['margins at torque: gain', 'Estimator: x += L (y - C x)', 'PASS: 2 of 2 checks'],
    'nodes': ['201 steps', 'the same, to '],
}
PICTURES = {
    'arrays': ['smoothed.png'],
    'design': ['margins.png', 'pendulum.png'],
    'nodes': ['cart_pole.png'],
}


def test_each_is_known():
    assert {path.stem for path in EXAMPLES.glob('*.py')} == set(SAYS)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('name', SAYS)
def test_an_example_runs(name, tmp_path):
    if name == 'nodes':
        pytest.importorskip('rclpy')
    path = EXAMPLES / f'{name}.py'
    assert len(path.read_text().splitlines()) <= 70
    result = subprocess.run(
        [sys.executable, path], capture_output=True, text=True, timeout=110, cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    for words in SAYS[name]:
        assert words in result.stdout, result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
    drawn = sorted(tmp_path.glob('*.png'))
    assert [picture.name for picture in drawn] == PICTURES[name]
    if name == 'nodes':
        (line,) = (line for line in result.stdout.splitlines() if 'the same, to' in line)
        assert float(line.rpartition(' ')[2]) < 1e-9
