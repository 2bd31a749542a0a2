# SPDX-License-Identifier: Apache-2.0
"""An estimator works while its model is compiled, and changes over to it."""

import pytest
from rclpy.parameter import Parameter

pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')

from kalman_ros.compiled import library
from kalman_ros.compiled.parts import VARIABLE
from kalman_ros.core import Gaussian
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

pytestmark = pytest.mark.slow  # the compiler is another process


@pytest.fixture
def start(pair, tmp_path, monkeypatch):
    """Return a function that starts an estimator with a cache that is empty."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(library, '_known', {})

    def started(model='cart_pole', **parameters):
        return pair(EstimatorNode, str(shipped.file(model)), **parameters)

    return started


def change(node, name, value):
    result = node.set_parameters_atomically([Parameter(name, value=value)])
    assert result.successful, result.reason


def arithmetic(node):
    return node.report()[2]['arithmetic']


@pytest.mark.thorough
def test_casadi_computes_until_the_compiler_is_done(start):
    found = start()
    node = found.node
    assert arithmetic(node) == 'CasADi (it is being compiled)'
    before = node._online.filter.model
    node._fuser.reset(Gaussian([0.1, 0.2, 0.3, 0.4], node._online.belief.covariance))
    found.until(lambda: arithmetic(node) == 'C', 'the node does not change over')
    assert node._online.filter.model is not before
    assert node._online.belief.mean.tolist() == [0.1, 0.2, 0.3, 0.4]
    timer = node._changeover._timer
    assert timer.is_canceled()
    # other numbers are no reason to compile, and zeros are
    change(node, 'model_parameters.pole_mass', 0.3)
    assert arithmetic(node) == 'C'
    change(node, 'model_parameters.friction', 0.0)
    assert arithmetic(node) == 'CasADi (it is being compiled)'
    found.until(lambda: arithmetic(node) == 'C', 'the node does not change over again')
    assert node.scenario.model.state.names == before.state.names


def test_what_was_compiled_before_is_there_at_once(start):
    from kalman_ros import scenario
    from kalman_ros.compiled.parts import parts
    from kalman_ros.scenario.parameter_files import from_file

    believed = scenario.build(from_file(shipped.file('cart_pole'), 'estimator')).believed
    parts(believed.model, believed.sensors)
    library._known.clear()
    assert arithmetic(start().node) == 'C'


def test_a_compiler_that_fails_leaves_the_work_to_casadi(start, monkeypatch):
    monkeypatch.setattr(library, '_anywhere', lambda *_: (_ for _ in ()).throw(OSError('no room')))
    found = start()
    expected = 'CasADi (the C compiler failed: no room)'
    found.until(lambda: arithmetic(found.node) == expected, 'it is not said why')
    assert found.node._changeover._timer.is_canceled()


def test_in_lockstep_results_do_not_depend_on_a_compiler_so_it_is_waited_for(start):
    assert arithmetic(start(lockstep='true').node) == 'C'


def test_numpy_may_be_chosen(start):
    assert arithmetic(start(arithmetic='numpy').node) == 'numpy'


def test_filterpy_uses_numpy(start):
    assert arithmetic(start(implementation='filterpy').node) == 'numpy'


def test_the_whole_filter_in_c_is_compiled_beside_the_work(start, tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    library._known.clear()
    found = start(arithmetic='c')
    assert 'c: it is being compiled' in arithmetic(found.node)
    found.until(lambda: arithmetic(found.node) == 'c', 'the node does not change over')


def test_a_linear_estimator_needs_none(start):
    assert arithmetic(start('mass_spring_damper').node) == 'numpy'


def test_an_arithmetic_that_is_unknown_is_refused(start):
    with pytest.raises(ValueError, match=r"^arithmetic: expected compiled, numpy or c, got 'f"):
        start(arithmetic='fast')
