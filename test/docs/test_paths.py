# SPDX-License-Identifier: Apache-2.0
"""Every file and folder that the pages mention is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    page.relative_to(ROOT)
    for page in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').rglob('*.md'))
)
#: Where a page's paths may start: it calls `kalman_ros/linear/riccati.py` `linear/riccati.py`.
STARTS = ('', 'kalman_ros')
#: Made by a run, not kept.
MADE = ('out', '.venv')
#: In backticks, a folder with its slash or a file with its ending; anywhere, what is below a
#: folder of the repository; and the targets of links.
MENTIONS = (
    r'`((?:[\w.-]+/)+)`',
    r'`((?:[\w.-]+/)+[\w.-]+\.(?:py|md|yaml|xml|toml|txt|png|svg))`',
    r'(?<![\w./:-])((?:kalman_ros|test|docs|config|\.ci)/[\w./-]*\w/?)',
    r'\]\((?!\w+:)([^)#]+)(?:#[^)]*)?\)',
)


def mentioned(text):
    found = (path for pattern in MENTIONS for path in re.findall(pattern, text))
    return sorted({path for path in found if not re.search(r'\b[A-Z_]{2,}\b', Path(path).stem)})


def is_there(path, page):
    folders = (page.parent, *(ROOT / start for start in STARTS))
    return Path(path).parts[0] in MADE or any((folder / path).exists() for folder in folders)


@pytest.mark.parametrize('page', PAGES, ids=str)
def test_what_a_page_mentions_is_there(page):
    paths = mentioned((ROOT / page).read_text())
    assert [path for path in paths if not is_there(path, ROOT / page)] == []


def test_stale_paths_are_found():
    text = 'in `commands/studies/`, `linear/gone.py` or [here](gone.md), see kalman_ros/gone.py'
    paths = mentioned(text)
    assert paths == ['commands/studies/', 'gone.md', 'kalman_ros/gone.py', 'linear/gone.py']
    assert not any(is_there(path, ROOT / 'README.md') for path in paths)
    assert is_there('linear/riccati.py', ROOT / 'README.md')
