# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of public names run, and print what stands there."""

import doctest
import inspect

import pytest

pytest.importorskip('rclpy')

import kalman_ros as kr

EXAMPLES = {name: inspect.getdoc(getattr(kr, name)) or '' for name in kr.__all__}
EXAMPLES = {name: text for name, text in EXAMPLES.items() if '>>>' in text}
#: Names whose examples need a recording, nodes, a compiler, or an error.
WITHOUT = {'DesignError', 'Run', 'export', 'replay'}


def test_every_name_has_an_example_but_those_that_need_more():
    assert {*kr.__all__} - EXAMPLES.keys() == WITHOUT


@pytest.mark.slow
@pytest.mark.parametrize('name', EXAMPLES)
def test_an_example_prints_what_stands_there(name):
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, name, 0)
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE, verbose=False)
    runner.run(test, out=said.append)
    assert not runner.failures, ''.join(said)
