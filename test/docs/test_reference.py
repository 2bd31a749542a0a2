# SPDX-License-Identifier: Apache-2.0
"""The pages of reference are those that the declarations give."""

import importlib.util
import re
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

DOCS = Path(__file__).parents[2] / 'docs'


def module(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f'{name}.py')
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def written():
    return module('make_reference').PAGES


@pytest.mark.parametrize('name', ['parameters.md', 'api.md', 'names.md'])
def test_the_page_is_up_to_date(name):
    text = '\n'.join(written()[name]()) + '\n'
    assert (DOCS / 'reference' / name).read_text() == text, 'run: ./dev reference'


def test_each_parameter_is_an_entry_with_an_address():
    page = (DOCS / 'reference' / 'parameters.md').read_text()
    text = module('parameter_entries').entries(page)
    names = re.findall(r'^```\{confval\} (.+)$', text, re.MULTILINE)
    assert len(names) == len(set(names)) == page.count('\n| `')
    assert {'SENSOR.gate', 'model_parameters.gravity (cart_pole)', 'seed (plant)'} <= set(names)
    entry = text[text.index('```{confval} SENSOR.gate\n') :].split('```')[1]
    assert 'default `1.0`, 0.5 to 1, changes at run time' in entry
    assert '| name |' not in text
