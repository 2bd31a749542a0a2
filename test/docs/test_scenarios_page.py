# SPDX-License-Identifier: Apache-2.0
"""Every scenario has its section: the command, what to see, a picture, what was measured."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CONFIGS = sorted(path.stem for path in (ROOT / 'config').glob('*.yaml'))
PAGE = (ROOT / 'docs' / 'reference' / 'scenarios.md').read_text()
SECTIONS = dict(re.findall(r'^## (\w+)\n(.*?)(?=^## |\Z)', PAGE, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize('name', CONFIGS)
def test_a_scenario_has_its_section(name):
    section = SECTIONS[name]
    assert re.search(rf'^    \./dev demo {name}( |$)', section, re.MULTILINE)
    assert 'Measured: ' in section
    (picture,) = re.findall(r'!\[.+\]\((scenarios/\w+\.png)\)', section)
    assert picture == f'scenarios/{name}.png'
    assert 5_000 < (ROOT / 'docs' / 'reference' / picture).stat().st_size < 60_000


def test_no_section_is_of_a_scenario_that_is_gone():
    assert sorted(SECTIONS) == CONFIGS


@pytest.mark.parametrize('page', sorted((ROOT / 'docs').rglob('*.md')), ids=lambda p: p.stem)
def test_what_a_page_links_to_is_there(page):
    for target in re.findall(r'\]\(([^)#]+)\)', page.read_text()):
        assert target.startswith('http') or (page.parent / target).exists(), target


LARGEST = {
    name: found.group(1)
    for name, section in SECTIONS.items()
    if (found := re.search(r'largest error ([\d.]+) deviations', section))
}


@pytest.mark.thorough
@pytest.mark.parametrize('name', sorted(LARGEST))
def test_what_was_measured_is_what_the_command_prints(name, tmp_path):
    from kalman_ros.programs import demo

    with pytest.raises(SystemExit):
        demo.main([name, '--out', str(tmp_path)])
    checks = json.loads((tmp_path / 'summary.json').read_text())['checks']
    largest = max(c['measured'] for c in checks if c['name'].startswith('largest error'))
    assert f'{largest:.1f}' == LARGEST[name]
    shown = {float(n) for n in re.findall(r'\d\.\d\d+', SECTIONS[name].split('Measured: ')[1])}
    for check in checks:
        if check['name'].startswith('NIS'):
            assert min(abs(check['measured'] - each) for each in shown) < 0.0051, check['name']
