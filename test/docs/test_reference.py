# SPDX-License-Identifier: Apache-2.0
"""The pages of reference are those that the declarations give."""

import importlib.util
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

DOCS = Path(__file__).parents[2] / 'docs'


def written():
    spec = importlib.util.spec_from_file_location('make_reference', DOCS / 'make_reference.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PAGES


@pytest.mark.parametrize('name', ['parameters.md', 'api.md', 'names.md'])
def test_the_page_is_up_to_date(name):
    text = '\n'.join(written()[name]()) + '\n'
    assert (DOCS / 'reference' / name).read_text() == text, 'run: python docs/make_reference.py'
