# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of public names run, and print what stands there."""

import doctest
import inspect

import pytest

pytest.importorskip('rclpy')

import kalman_ros as kr

FUNCTIONS = [name for name in kr.__all__ if inspect.isfunction(getattr(kr, name))]
EXAMPLES = {name: inspect.getdoc(getattr(kr, name)) for name in FUNCTIONS}
EXAMPLES = {name: text for name, text in EXAMPLES.items() if '>>>' in text}


def test_most_functions_have_an_example():
    assert len(EXAMPLES) >= 22
    assert {'lqr', 'lqe', 'place', 'margins', 'filter', 'design', 'simulate'} <= EXAMPLES.keys()


@pytest.mark.slow
@pytest.mark.parametrize('name', EXAMPLES)
def test_an_example_prints_what_stands_there(name):
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, name, 0)
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE, verbose=False)
    runner.run(test, out=said.append)
    assert not runner.failures, ''.join(said)
