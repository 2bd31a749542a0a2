# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_robot_in_the_readme_is_the_one_that_is_tested():
    """With its imports: a person copies what is there."""
    path = ROOT / 'test' / 'packages' / 'pendulum_robot' / 'pendulum_robot' / 'pendulum.py'
    source = path.read_text()
    shown = source[source.index('from typing') :]
    for page in ('README.md', 'docs/how_to/own_model.md'):
        assert f'```python\n{shown}```' in (ROOT / page).read_text()
