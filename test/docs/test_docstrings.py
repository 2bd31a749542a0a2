# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of public names run, and print what stands there."""

import dataclasses
import doctest
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from tools.strangers.injected.bag import write_bag
from tools.strangers.injected.recordings import Injection

import kalman_ros as kr

EXAMPLES = {name: inspect.getdoc(getattr(kr, name)) or '' for name in kr.__all__}
EXAMPLES = {name: text for name, text in EXAMPLES.items() if '>>>' in text}


def test_every_name_but_an_error_has_an_example():
    assert {*kr.__all__} - EXAMPLES.keys() == {'DesignError'}


def described(obj):
    """Return the names under Parameters in the docstrings of an object and of its bases."""
    names = set()
    for each in getattr(obj, '__mro__', (obj,)):
        text = inspect.cleandoc(each.__doc__ or '') if 'kalman_ros' in each.__module__ else ''
        section = re.search(r'Parameters\n-+\n(.*?)(\n\n[A-Z][a-z]+\n-+\n|\Z)', text, re.DOTALL)
        lines = section[1].splitlines() if section else []
        names |= {n.strip(' *') for line in lines if line[:1].strip() for n in line.split(',')}
    return names


def results():
    """Return the classes that the page of the interface lists under Results."""
    page = Path(__file__).parents[2] / 'docs' / 'reference' / 'api.md'
    for module, name in re.findall(r'^   (kalman_ros\.\S+)\.(\w+)$', page.read_text(), re.M):
        yield getattr(import_module(module), name)


def test_every_argument_and_every_field_is_described():
    missing = []
    for obj in (*(getattr(kr, name) for name in kr.__all__), *results()):
        if dataclasses.is_dataclass(obj):
            given = [field.name for field in dataclasses.fields(obj)]
        elif isinstance(obj, type):
            given = list(getattr(obj, '_fields', ()))
        else:
            given = list(inspect.signature(obj).parameters)
        public = {name for name in given if not name.startswith('_')}
        missing += [f'{obj.__name__}: {name}' for name in sorted(public - described(obj))]
    assert not missing


@pytest.mark.slow
@pytest.mark.parametrize('name', EXAMPLES)
def test_an_example_prints_what_stands_there(name, tmp_path, monkeypatch):
    if name == 'export':
        pytest.importorskip('casadi')
    monkeypatch.chdir(tmp_path)
    if 'monday' in EXAMPLES[name]:
        write_bag('monday', 'mass_spring_damper', Injection(), 30.0, 3)
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, name, 0)
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE, verbose=False)
    runner.run(test, out=said.append)
    assert not runner.failures, ''.join(said)
