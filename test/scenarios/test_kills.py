# SPDX-License-Identifier: Apache-2.0
"""Each node is killed again and again, in real time: the rest keeps its promises meanwhile."""

import time
from collections import defaultdict

import numpy as np
import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from tools.soak.machine import Withheld

from kalman_ros.codecs.messages import nanoseconds
from kalman_ros.harness import Run

pytestmark = pytest.mark.real_time

KILLS = 16
TIMEOUT, PERIOD = 0.3, 0.01
#: From a reading to its force, unless the machine is overloaded.
ROUND_TRIP = 0.02
#: The input dominates the motion, so the truth shows which input acted.
OVERRIDES = {'force_timeout': TIMEOUT, 'estimate_timeout': TIMEOUT, 'run_until': 1e6}
ONLY = {'plant': {'model_parameters.force_noise': 1e-12}}


class Loop:
    """A loop whose nodes are killed and started again, and its messages."""

    def __init__(self, run):
        self.run, self.said, self.logs = run, defaultdict(list), []
        self.forces, self.estimates = [], []
        #: When, in nanoseconds, the plant was without a controller: from a stamp to another.
        self.unforced = []
        listen = run.node.create_subscription
        listen(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        listen(WrenchStamped, 'force', self._on_force, 1000)
        listen(Odometry, 'estimate', self._on_estimate, 1000)

    def _on_diagnostics(self, array):
        for status in array.status:
            self.said[status.name].append((nanoseconds(array.header.stamp), status.message))

    def _on_force(self, message):
        force = message.wrench.force
        self.forces.append((nanoseconds(message.header.stamp), force.x, force.y))

    def _on_estimate(self, message):
        self.estimates.append(nanoseconds(message.header.stamp))

    def now(self):
        return self.run.node.get_clock().now().nanoseconds

    def says(self, node, words):
        """Wait until a node says ``words``, from now on; return when it did."""
        since = len(self.said[node])

        def found():
            return [at for at, message in self.said[node][since:] if words in message]

        self.run.wait(found, 20.0, lambda: f'{node}: {self.said[node][-1:]}, not {words!r}')
        return found()[0]

    def kill(self, node):
        self.logs.append(self.run.processes[node].output())
        self.run.kill(node)

    def restart(self, node):
        """Start a node again; return the seconds until it speaks and the loop is closed."""
        began, since, at = time.monotonic(), len(self.said[node]), self.now()
        self.run.start(node)
        returned = lambda: len(self.said[node]) > since and self.closed(at)  # noqa: E731
        self.run.wait(returned, 20.0, lambda: f'no loop after the {node} returned')
        seconds = time.monotonic() - began
        for other in ('plant', 'controller'):
            self.says(other, 'running')
        return seconds

    def closed(self, since):
        """Return whether a force answers an estimate that is newer than ``since``."""
        stamp, *force = self.forces[-1]
        return stamp > since and any(force) and stamp in self.estimates[-20:]


def without_controller(loop, delay):
    """The plant lets the force go to zero in time, and says why."""
    at = loop.says('plant', 'no force received: it is zero')
    late = (at - loop.forces[-1][0]) * 1e-9 - TIMEOUT
    assert 0.0 <= late < PERIOD + ROUND_TRIP + delay()
    loop.run.spin(0.2)
    loop.unforced.append((at, loop.now()))


def without_estimator(loop, delay):
    """The controller lets the force go to zero one period after its timeout, and says why."""
    loop.says('controller', 'no estimate received')
    last = loop.estimates[-1]
    after = [force for force in loop.forces if force[0] > last]
    assert not np.any([force[1:] for force in after])
    late = (after[0][0] - last) * 1e-9 - TIMEOUT
    assert 0.0 <= late < PERIOD + ROUND_TRIP + delay()


def without_plant(loop, delay):
    """Estimator and controller report missing messages; the force is zero."""
    loop.says('controller', 'no estimate received')
    loop.says('estimator', 'no readings of position and velocity received')
    assert not any(loop.forces[-1][1:])


def without_monitor(loop, delay):
    """Nobody notices."""
    count, since = len(loop.forces), {node: len(said) for node, said in loop.said.items()}
    loop.run.spin(1.5)
    stamps = [force[0] * 1e-9 for force in loop.forces[count:]]
    assert np.diff(stamps).max() < 2.0 * PERIOD + ROUND_TRIP + delay()
    for node in ('plant', 'controller'):
        assert {message for _, message in loop.said[node][since[node] :]} == {'running'}


WITHOUT = {
    'controller': without_controller,
    'estimator': without_estimator,
    'plant': without_plant,
    'monitor': without_monitor,
}


@pytest.mark.timeout(500)
def test_the_loop_recovers_from_the_death_of_each_node(capfd):
    random, recovery = np.random.default_rng(7), defaultdict(list)
    with Run(overrides=OVERRIDES, only=ONLY, lockstep=False, seed=3) as run:
        loop = Loop(run)
        run.wait(lambda: loop.forces and loop.closed(0), 10.0, lambda: 'the loop is not closed')
        for number in range(KILLS):
            node = list(WITHOUT)[number % len(WITHOUT)]
            run.spin(random.uniform(0.1, 0.7))
            others = [process.pid for name, process in run.processes.items() if name != node]
            delay = Withheld(others)
            loop.kill(node)
            WITHOUT[node](loop, delay)
            recovery[node].append(loop.restart(node))
        loop.logs += [process.output() for process in run.processes.values()]
        truth = run.recorder['ground_truth']
        recorded = {topic: run.recorder[topic].values for topic in run.recorder.raw}
        step = run.scenario.model.transition(*run.scenario.model.equilibrium, PERIOD)
    with capfd.disabled():
        print('\nseconds from the start of a node that was killed until the loop is closed again')
        for node, seconds in recovery.items():
            low, middle, high = np.percentile(seconds, (0, 50, 100))
            print(f'  {node:10} {low:.2f} to {high:.2f}, median {middle:.2f}')
    assert not [log for log in loop.logs if 'Traceback' in log]
    assert [topic for topic, values in recorded.items() if not np.isfinite(values).all()] == []
    assert np.abs(truth.values).max() < 3.0
    pushed = inputs(step, truth)
    assert len(loop.unforced) == len([k for k in range(KILLS) if k % 4 == 0])
    for start, end in loop.unforced:
        within = [u for at, u in pushed if start < at < end]
        assert within
        assert np.abs(within).max() < 1e-3


def inputs(step, truth):
    """Return each time in the truth, and the input that must have acted from it to the next."""
    following = np.abs(np.diff(truth.stamp) - PERIOD * 1e9) < 10
    before, after = truth.values[:-1][following], truth.values[1:][following]
    u = (after - before @ step.F.T) @ np.linalg.pinv(step.G).T
    return list(zip(truth.stamp[:-1][following], u))
