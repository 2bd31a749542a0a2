# SPDX-License-Identifier: Apache-2.0
"""How a node ends: at rest before anything that may wait. And an answer that comes late counts."""

import gc
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.task import Future

from kalman_ros.control.limiter import Limiter, limits_of
from kalman_ros.nodes.controller.output import OutputStage
from kalman_ros.nodes.middleware import runtime


class Witness:
    """Writes down which of its methods were called, in order."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        return lambda *_, **__: self.calls.append(name)


@pytest.fixture
def unfrozen():
    yield
    gc.unfreeze()


@pytest.mark.parametrize('error', [None, RuntimeError('of a model')])
def test_a_node_rests_before_its_executor_waits_for_its_threads(error, monkeypatch, unfrozen):
    witness, interruption = Witness(), SimpleNamespace(asked=Future(), ignore=lambda: None)

    def spin(asked, _):
        assert gc.get_freeze_count() > 1000
        if error:
            raise error
        asked.set_result(None)

    executor = SimpleNamespace(
        add_node=lambda _: None,
        spin_until_future_complete=spin,
        shutdown=lambda: witness.calls.append('shutdown'),
    )
    monkeypatch.setattr(runtime, 'EventsExecutor', lambda: executor)
    if error:
        with pytest.raises(RuntimeError, match='of a model'):
            runtime._spin(witness, interruption)
    else:
        runtime._spin(witness, interruption)
    assert witness.calls == ['own_process', 'rest', 'shutdown']


@pytest.mark.slow
def test_an_end_that_waits_for_itself_is_cut_off():
    """What waits holds the lock of the interpreter, as a middleware may."""
    code = (
        'import ctypes\n'
        'from kalman_ros.nodes.middleware import runtime\n'
        'runtime._END = 0.2\n'
        'with runtime._bounded():\n'
        '    pass\n'
        'print("ended", flush=True)\n'
        'with runtime._bounded():\n'
        '    ctypes.PyDLL(None).sleep(60)\n'
    )
    out = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=50)
    assert (out.returncode, out.stdout) == (1, 'ended\n')
    assert 'Timeout' in out.stderr and 'File' in out.stderr


def test_an_output_that_is_closed_does_not_wait_for_subscribers():
    """Only the owner of the publisher waits; the node would receive nothing meanwhile."""
    publisher = Witness()
    limiter = Limiter(limits_of(1, {'input_limit': 5.0}), np.zeros(1))
    output = OutputStage(publisher, lambda *_: b'', limiter, 0.01, simulated=False)
    output.open()
    output.command(0, np.array([1.0]))
    output.close(lambda: 0)
    assert publisher.calls == ['publish', 'publish']
    assert output.at_idle
    output.deliver()
    assert publisher.calls[2:] == ['wait_for_all_acked']
