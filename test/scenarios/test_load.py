# SPDX-License-Identifier: Apache-2.0
"""More than there is time for: twenty sensors at once, and one that floods."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from tools.soak.machine import Withheld

from kalman_ros.harness import Run

pytestmark = pytest.mark.real_time

PERIOD = 0.01
#: Of a flood, in Hz.
RATE = 5000
FLOOD = Path(__file__).with_name('flood.py')


def twenty():
    """Return the default system with ten of each of its sensors, each at 100 Hz."""
    found = {'sensors': [f'{kind}_{k}' for k in range(10) for kind in ('place', 'speed')]}
    of_kind = {
        'place': {
            'measures': ['x', 'y'],
            'noise': [0.5, 0.5],
            'type': 'geometry_msgs/PoseWithCovarianceStamped',
            'fields': ['pose.pose.position.x', 'pose.pose.position.y'],
        },
        'speed': {
            'measures': ['v_x', 'v_y'],
            'noise': [0.5, 0.5],
            'type': 'geometry_msgs/TwistWithCovarianceStamped',
            'fields': ['twist.twist.linear.x', 'twist.twist.linear.y'],
        },
    }
    for name in found['sensors']:
        options = {
            **of_kind[name[:5]],
            'kind': 'states',
            'rate': 100.0,
            'topic': name,
            'reliable': True,
        }
        found.update({f'{name}.{key}': value for key, value in options.items()})
    return found


def fates(run, name):
    """Return how many readings of a sensor came to the estimator, and what became of them."""
    said = run.diagnostics['estimator'].values
    prefix = f'{name}: '
    counts = {
        value.key[len(prefix) :]: int(value.value)
        for value in said
        if value.key.startswith(prefix) and not value.key.endswith(']') and value.value.isdigit()
    }
    return counts.pop('readings'), counts


def silent(stamps, start, end):
    """Return for how long no force came between two times, beyond the two steps that are usual."""
    within = np.unique(stamps[(stamps >= start) & (stamps <= end)])
    gaps = np.diff(np.concatenate(([start], within, [end])))
    return np.maximum(0.0, gaps - 2.0 * PERIOD).sum()


def test_twenty_sensors_at_100_hz():
    with Run(twenty(), lockstep=False, seed=2) as run:
        stolen = Withheld([])
        run.advance(14.0)
        lost = stolen()
        found = run.trajectory()
        stamps = run.recorder['force'].stamp * 1e-9
        run.refresh('plant', 'estimator', 'controller')
        accounts = {name: fates(run, name) for name in run.scenario.sensors}
        sent = {name: int(run.reported('plant', f'{name}: readings')) for name in accounts}
        age = run.reported('controller', 'age of estimates, 50 / 90 / 99 % [ms]')
    assert len(accounts) == 20
    # a reading's stamp is when it was taken, and never ahead of the clock
    assert 0.0 < float(age.split(' / ')[0]) < 1e3 * PERIOD, age
    for name, (came, became) in accounts.items():
        assert came == sent[name] > 1000
        assert became == {'fused': came}
    assert silent(stamps, stamps[0], stamps[-1]) < 0.05 * 14.0 + lost
    # better than any of them alone
    assert np.std(found.truth - found.estimate, axis=0).max() < 0.2


class Flood:
    """A run with a program that floods the estimator with velocities, and their outcomes."""

    def __init__(self, run, seconds, rate=RATE, lag=0.0, *, reliable=True):
        self.run = run
        command = [sys.executable, str(FLOOD), *map(str, (rate, seconds, lag, int(reliable)))]
        run.set_parameter('run_until', 1e6)
        self._process = subprocess.Popen(
            command, env=run.environment, stdout=subprocess.PIPE, text=True
        )

    def wait(self):
        """Wait for its end and until all is said."""
        run, process = self.run, self._process
        try:
            run.wait(lambda: process.poll() is not None, 30.0, lambda: 'the flood does not end')
        finally:
            process.kill()
        count, self.start, self.end = map(float, process.communicate()[0].split())
        run.set_parameter('run_until', 0.0)
        self.came = -1
        while (now := fates(run, 'velocity'))[0] != self.came:  # all that waits is taken in
            self.came, self.became = now
            run.spin(1.0)
            run.refresh('plant', 'estimator')
        self.sent = count + int(run.reported('plant', 'velocity: readings'))


def test_a_flood_takes_no_control():
    with Run(overrides={'velocity.reliable': True}, lockstep=False, seed=4) as run:
        stolen = Withheld([])
        flood = Flood(run, 6.0)
        flood.wait()
        lost = stolen()
        stamps = run.recorder['force'].stamp * 1e-9
        found = run.trajectory()
    assert flood.came == flood.sent == sum(flood.became.values())
    assert flood.became['fused'] > 0.5 * flood.sent
    assert silent(stamps, flood.start, flood.end) < 0.05 * (flood.end - flood.start) + lost
    assert np.abs(found.truth - found.estimate)[100:].max() < 1.0


def test_a_flood_of_best_effort_leaves_the_stream_of_estimates():
    """The listener is a process of its own: in that of the flood it starves."""
    with Run(lockstep=False, seed=4) as run:
        stolen = Withheld([])
        flood = Flood(run, 4.0, rate=5000.0, reliable=False)
        flood.wait()
        lost = stolen()
        stamps = run.recorder['estimate'].stamp * 1e-9
    within = stamps[(stamps > flood.start) & (stamps < flood.end)]
    assert len(within) > 50.0 * (flood.end - flood.start - lost)
    assert np.diff(within).max() < 0.3 + lost


def test_a_flood_that_lags_restarts_nothing():
    """Ten old readings in a row come within each burst, between those that are up to date."""
    with Run(overrides={'velocity.reliable': True}, lockstep=False, seed=4) as run:
        flood = Flood(run, 3.0, rate=2000.0, lag=2.0)
        flood.wait()
        found = run.trajectory()
        assert run.reported('estimator', 'restarts') == '0'
    assert flood.came == flood.sent == sum(flood.became.values())
    assert flood.became['dropped: older than the window'] > 0.5 * flood.sent
    assert np.abs(found.truth - found.estimate)[100:].max() < 1.0


def test_of_a_flood_that_waits_the_oldest_are_dropped():
    with Run(overrides={'velocity.reliable': True}, lockstep=False, seed=4) as run:
        flood = Flood(run, 3.0)
        fused = lambda: run.recorder['estimate'].stamp  # noqa: E731
        run.wait(lambda: fused().size > 300, 20.0, lambda: 'no estimates')
        run.processes['estimator'].signal(signal.SIGSTOP)
        run.spin(0.5)
        again = time.time_ns()
        run.processes['estimator'].signal(signal.SIGCONT)
        flood.wait()
        stamps = fused()
    assert flood.came == sum(flood.became.values())
    # messages that the middleware gave up resending cannot be counted
    assert 0.9 * flood.sent < flood.came <= flood.sent
    assert flood.became['dropped: too many messages waiting'] > 0.3 * RATE
    # what it was doing when it was stopped, and then at once what is new
    gap = np.argmax(np.diff(stamps))
    assert stamps[gap + 1] > again - 20_000_000
