# SPDX-License-Identifier: Apache-2.0
"""Every option of a command, and every parameter of the reference, is in a test."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def words(folder, *endings):
    """Return the words in the files of a folder."""
    files = [path for ending in endings for path in folder.rglob(f'*{ending}')]
    text = '\n'.join(path.read_text() for path in files if path != Path(__file__))
    return text, set(re.findall(r'-{0,2}\w[\w-]*', text))


def test_every_option_of_a_command_is_in_a_test():
    source, _ = words(ROOT / 'kalman_ros' / 'programs', '.py')
    _, tested = words(ROOT / 'test', '.py')
    options = set(re.findall(r"'(--[a-z][a-z-]*)'", source))
    assert len(options) > 40 and options <= tested, options - tested


def test_every_parameter_is_in_a_test():
    page = (ROOT / 'docs' / 'reference' / 'parameters.md').read_text()
    names = {name.rpartition('.')[2] for name in re.findall(r'^\| `([\w.]+)`', page, re.MULTILINE)}
    _, tested = words(ROOT / 'test', '.py', '.yaml')
    assert len(names) > 150 and names <= tested, names - tested
