# SPDX-License-Identifier: Apache-2.0
"""Every chapter of the course has its commands, a picture, and a question with its answer."""

import doctest
import re
import shlex
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from kalman_ros import models
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.programs import design
from kalman_ros.programs.study import STUDIES
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import overrides

COURSE = Path(__file__).parents[2] / 'docs' / 'course'
CHAPTERS = sorted(COURSE.glob('[0-9]*.md'))
COMMAND = re.compile(r'(?:^    |`)\./dev (\w+)([^`\n]*)', re.MULTILINE)


def commands(chapter):
    """Return each command with its arguments; in a text a line break may be in the middle."""
    text = re.sub(r'(`[^`\n]*)\n([^`\n]*`)', r'\1 \2', chapter.read_text())
    return [(name, shlex.split(rest)) for name, rest in COMMAND.findall(text)]


@pytest.mark.parametrize('chapter', CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_is_complete(chapter):
    text = chapter.read_text()
    for part in ('| symbol | meaning |', '**Look at**', '**Try**', '**Question.**', '**Answer.**'):
        assert part in text, part
    assert text.index('**Question.**') < text.index('**Answer.**')
    pictures = re.findall(r'!\[[^\]]+\]\(([^)]+)\)', text)
    assert pictures
    for picture in pictures:
        assert (COURSE / picture).is_file(), picture
    assert f'({chapter.name})' in (COURSE / 'index.md').read_text()


@pytest.mark.parametrize('chapter', CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_takes_a_quarter_of_an_hour(chapter):
    """At 100 to 130 words a minute, formulas included."""
    text = chapter.read_text()
    assert 1200 <= len(text.split()) <= 2000
    for part in ('## The idea', 'a pencil', '```{explorable} ', '```pycon', '\n$$\n'):
        assert part in text, part


@pytest.mark.parametrize('chapter', CHAPTERS, ids=lambda path: path.stem)
def test_its_python_prints_what_is_shown(chapter):
    shown = '\n'.join(re.findall(r'^```pycon\n(.*?)^```', chapter.read_text(), re.M | re.S))
    test = doctest.DocTestParser().get_doctest(shown, {}, chapter.stem, str(chapter), 0)
    assert len(test.examples) > 1
    printed = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE, verbose=False)
    runner.run(test, out=printed.append)
    assert not printed, ''.join(printed)


@pytest.mark.parametrize('chapter', CHAPTERS, ids=lambda path: path.stem)
def test_its_commands_exist(chapter):
    found = commands(chapter)
    assert {'study', 'live'} <= {name for name, _ in found}
    for name, arguments in found:
        if name == 'study':
            assert set(arguments) <= set(STUDIES) and arguments
            continue
        if name == 'design':
            options = design.arguments(arguments)
            assert shipped.file(options.scenario)
            assert design.pairs('--within', options.within, design.INTERVAL)
            continue
        assert name in ('live', 'demo')
        scenario = models.DEFAULT
        if arguments[0] != '-p':
            scenario, *arguments = arguments
        options = arguments
        assert options[::2] == ['-p'] * (len(options) // 2)
        assert Adjustments(shipped.file(scenario), overrides(options[1::2])).sensors


def test_every_chapter_counts():
    assert len(CHAPTERS) == 12
    taught = {a for c in CHAPTERS for name, rest in commands(c) if name == 'study' for a in rest}
    assert taught == set(STUDIES)
