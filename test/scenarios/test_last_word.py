# SPDX-License-Identifier: Apache-2.0
"""However a controller stops acting, the idle input is its last word: flooded, on a busy machine.

Estimates come at 1 kHz and never stop, and as many processes as there are processors never rest.
"""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool
from tools.soak.machine import Withheld

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.harness import NodeError, Run, executables
from kalman_ros.nodes.middleware.interruption import WATCHER

FLOOD = Path(__file__).with_name('estimate_flood.py')
LIMIT = 20.0  # N/s
PERIOD = 0.01
#: Between a signal and the first smaller force.
PROMPT = 0.05 + PERIOD
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1)


@contextmanager
def ended(*commands, **options):
    """Have processes as long as the block lasts."""
    processes = [subprocess.Popen(command, **options) for command in commands]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def busy():
    with ended(*[[sys.executable, '-c', 'while True: pass']] * (os.cpu_count() or 1)):
        yield


@contextmanager
def flood(run, rate=1000.0):
    with ended([sys.executable, str(FLOOD), str(rate)], env=dict(run.environment)):
        yield


class Ear:
    """Every force that comes, when it came, and what is wrong with how they ended."""

    def __init__(self, run):
        self.run = run
        self.came, self._data = [], []
        self._read = WireReader(SignalCodec(run.scenario.input))
        queue = QoSProfile(depth=5000)
        run.node.create_subscription(WrenchStamped, 'force', self._on_force, queue, raw=True)

    def _on_force(self, data):
        self.came.append(time.monotonic())
        self._data.append(data)

    def samples(self, start=0):
        return [self._read(data) for data in self._data[start:]]

    @property
    def last(self):
        return self._read(self._data[-1]).values if self._data else np.zeros(2)

    def forces(self, start=0):
        return np.array([sample.values for sample in self.samples(start)]).reshape(-1, 2)

    def grows(self):
        """Wait until the force is large, and as large as it gets."""
        steady = lambda: self.last[0] < -2.0 and np.ptp(self.forces(-20)[:, 0]) == 0.0  # noqa: E731
        self.run.wait(steady, 60.0, lambda: f'the force is {self.last}')
        return len(self.came)

    def wrong_after(self, start, limit=LIMIT):
        """Return what is wrong with the forces since ``start``, once no more come."""
        idle = lambda: not self.last.any()  # noqa: E731
        with suppress(NodeError):  # reported below
            self.run.wait(idle, 10.0, lambda: '')
        self.run.spin(0.6)
        forces = self.forces(start)
        at_idle = np.flatnonzero((forces == 0.0).all(axis=1))
        if not at_idle.size:
            return f'never idle: {forces[-3:]}'
        after = len(forces) - 1 - at_idle[0]
        if after:
            return f'{after} forces follow the idle one, the last is {forces[-1]}'
        # stamps are never after the moment of publication; that of an answer is before it, by as
        # much as its estimate had to wait, and what came later was published later
        stamps = np.array([sample.time for sample in self.samples(start - 1)]) * 1e-9
        steps = np.abs(np.diff(self.forces(start - 1), axis=0)).max(axis=1)
        times = np.maximum(np.diff(stamps), np.diff(self.came[start - 1 : start + len(forces)]))
        over = steps > limit * times + 1e-5
        return f'steps of {steps[over]} within {times[over]} s' if over.any() else ''


def alone(**parameters):
    overrides = {'transition_time': 0.0, 'input_rate_limit': [LIMIT], **parameters}
    return Run(overrides=overrides, lockstep=False, nodes=('controller',))


def goes(run, transition, state):
    """Have the controller change its state; on a busy machine it may be asked twice."""
    run.change_state('controller', transition)
    assert run.state('controller') == state


def enable(run, on):
    assert run.call(SetBool, 'controller/enable', SetBool.Request(data=on)).success


@pytest.mark.real_time
def test_zero_is_the_last_message_of_a_controller_that_stops():
    with alone() as run, busy(), flood(run):
        ear, wrong = Ear(run), {}

        for count in range(4):
            start = ear.grows()
            goes(run, 'deactivate', 'inactive')
            wrong[f'deactivate {count}'] = ear.wrong_after(start)
            goes(run, 'activate', 'active')
        start = ear.grows()
        goes(run, 'deactivate', 'inactive')
        goes(run, 'cleanup', 'unconfigured')
        wrong['cleanup'] = ear.wrong_after(start)
        goes(run, 'configure', 'inactive')
        goes(run, 'activate', 'active')
        start = ear.grows()
        enable(run, on=False)
        wrong['disable'] = ear.wrong_after(start)
        enable(run, on=True)
        start = ear.grows()
        goes(run, 'shutdown', 'finalized')
        wrong['shutdown'] = ear.wrong_after(start)
        assert {how: found for how, found in wrong.items() if found} == {}


@pytest.mark.real_time
@pytest.mark.parametrize('storm', [False, True])
def test_zero_is_the_last_word_after_every_signal_and_soon(storm):
    with alone() as run, busy(), flood(run):
        ear, wrong = Ear(run), {}
        for number in ENDING:
            if 'controller' not in run.processes:
                run.start('controller')
            start = ear.grows()
            steady = ear.last[0]
            process = run.processes.pop('controller')
            withheld, waited = Withheld([process.pid], (WATCHER,)), 0.0
            at = time.time_ns()
            for _ in range(200 if storm else 1):
                process.signal(number)
            while ear.last[0] <= steady and time.time_ns() - at < 20e9:
                waited = max(waited, withheld())
                run.spin(0.01)
            stamps = [s.time for s in ear.samples(start) if s.values[0] > steady]
            wrong[number] = ear.wrong_after(start)
            # by the controller's own clock, for this process, too, may have to wait
            took = (stamps[0] - at) * 1e-9 if stamps else np.inf
            if took - waited > PROMPT:
                wrong[number] += f' a smaller force after {took:.3f} s, {waited:.3f} s withheld'
            assert process.wait(10.0)
            if process.exit_code:
                wrong[number] += f' exit code {process.exit_code}'
        assert {number: found for number, found in wrong.items() if found} == {}


@pytest.mark.real_time
def test_zero_is_the_last_word_when_the_terminal_is_closed():
    with alone(autostart=False) as run, flood(run):
        ear = Ear(run)
        run.kill('controller', signal.SIGTERM)
        ours, its = pty.openpty()
        command = [str(executables.executable('controller')), '--ros-args']
        command += ['-p', 'transition_time:=0.0', '-p', f'input_rate_limit:=[{LIMIT}]']
        with ended(
            command,
            env=dict(run.environment),
            stdin=its,
            stdout=its,
            stderr=its,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        ) as (process,):
            os.close(its)
            start = ear.grows()
            os.close(ours)
            assert ear.wrong_after(start) == ''
            assert process.wait(10.0) == 0


BREAKING = """
from dataclasses import replace
from functools import wraps

from kalman_ros.core import LinearSystem
from kalman_ros.scenario.wiring import system

SYSTEM = system('mass_spring_damper_2d')


class Breaking(LinearSystem):
    def step(self, x, u, dt):
        if x[0] > 5.0:
            raise {error}
        return super().step(x, u, dt)


@wraps(SYSTEM.build)
def build(**parameters):
    model = SYSTEM.build(**parameters)
    model.__class__ = Breaking
    return model


BREAKING = replace(SYSTEM, build=build)
"""


@pytest.mark.real_time
@pytest.mark.parametrize('error', ["RuntimeError('out of range')", 'SystemExit(3)'])
def test_zero_is_the_last_word_when_a_model_raises(error, monkeypatch, tmp_path):
    (tmp_path / 'breaking.py').write_text(BREAKING.format(error=error))
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'breaking', raising=False)
    with alone(model='breaking:BREAKING', predict_latency=True) as run, flood(run, 200.0):
        ear = Ear(run)
        run.wait(lambda: ear.last[0] < -2.0, 20.0, lambda: f'the force is {ear.last}')
        estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        run.wait(estimates.get_subscription_count, 10.0, lambda: 'no subscriber')
        process, message = run.processes.pop('controller'), Odometry()
        start = len(ear.came)
        for _ in range(100):
            message.pose.pose.position.x = 9.0
            write_stamp(message.header.stamp, time.time_ns())
            estimates.publish(message)
            run.spin(0.02)
            if process.exit_code is not None:
                break
        assert process.wait(10.0)
        assert process.exit_code
        assert ear.wrong_after(start, limit=np.inf) == ''


@pytest.mark.real_time
def test_a_message_that_cannot_be_decoded_is_dropped():
    # of any age: a machine that is busy may make them old, and that would change the force
    with alone(estimate_timeout=0.0) as run, flood(run, 200.0):
        ear = Ear(run)
        ear.grows()
        estimates = run.node.create_publisher(Odometry, 'estimate', 100)
        run.wait(estimates.get_subscription_count, 10.0, lambda: 'no subscriber')
        key = 'undecodable: /estimate'
        dropped = lambda: int((run.reported('controller', key) or '0').split(',')[0])  # noqa: E731
        send = lambda: estimates.publish(bytes(20))  # noqa: E731
        run.wait(lambda: send() or dropped() > 10, 10.0, dropped)
        log = run.processes['controller'].output()
        assert 'estimate: dropped a message of 20 bytes: undecodable' in log
        assert (ear.forces(-100)[:, 0] < -2.0).all()
        start = ear.grows()
        assert run.change_state('controller', 'deactivate')
        assert ear.wrong_after(start) == ''


def excess(ear, sent, limit):
    """Return by how much more than ``limit`` per second the force changed between any two answers.

    An answer was published after its estimate was ``sent``, at a time by stamp, and before it
    came: so between two of them there was no more time than is reckoned with here.
    """
    answers = [
        (sent[sample.time], came, sample.values[0])
        for sample, came in zip(ear.samples(), ear.came)
        if sample.time in sent
    ]
    began, came, forces = np.array(answers).T
    first, second = np.triu_indices(len(answers), 1)
    change = np.abs(forces[second] - forces[first])
    return (change - limit * (came[second] - began[first])).max()


@pytest.mark.real_time
@pytest.mark.parametrize('ahead', ['once', 'zigzag'])
def test_the_rate_limit_holds_by_the_wall_clock(ahead):
    """Whatever stamps say: one that is ahead, or stamps that zigzag."""
    with alone(input_rate_limit=[10.0]) as run:
        ear = Ear(run)
        estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        run.wait(estimates.get_subscription_count, 10.0, lambda: 'no subscriber')
        message, sent = Odometry(), {}

        def send(x, offset=0.0):
            stamp = time.time_ns() + round(offset * 1e9)
            sent[stamp] = time.monotonic()
            message.pose.pose.position.x = x
            write_stamp(message.header.stamp, stamp)
            estimates.publish(message)
            run.spin(0.01)

        for _ in range(20):
            send(0.0)
        if ahead == 'once':
            send(5.0, 0.45)
        for count in range(60):
            send(5.0, 0.4 * (count % 2) if ahead == 'zigzag' else 0.0)
        assert excess(ear, sent, 10.0) < 1e-6
        assert ear.forces()[:, 0].min() < -1.0


@pytest.mark.real_time
def test_a_filter_on_two_topics_is_no_fault():
    """It publishes an estimate for each reading, older ones after newer ones."""
    with alone(input_rate_limit=[np.inf]) as run:
        ear = Ear(run)
        estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        run.wait(estimates.get_subscription_count, 10.0, lambda: 'no subscriber')
        message = Odometry()
        message.pose.pose.position.x = 1.0
        for _ in range(150):
            for age in (0.0, 0.03):
                write_stamp(message.header.stamp, time.time_ns() - round(age * 1e9))
                estimates.publish(message)
                run.spin(0.005)
        ignored = lambda: run.reported('controller', 'estimates ignored: older than the last')  # noqa: E731
        run.wait(lambda: int(ignored() or 0) > 100, 60.0, ignored)
        assert (ear.forces()[:, 0] < -1.0).all()
        log = run.processes['controller'].output()
        assert 'went back' not in log


@pytest.mark.real_time
def test_a_time_that_began_again_is_followed_soon():
    with alone(input_rate_limit=[np.inf], estimate_timeout=5.0) as run:
        ear = Ear(run)
        estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        run.wait(estimates.get_subscription_count, 10.0, lambda: 'no subscriber')
        message = Odometry()

        def send(x, age):
            message.pose.pose.position.x = x
            write_stamp(message.header.stamp, time.time_ns() - round(age * 1e9))
            estimates.publish(message)
            run.spin(0.01)

        run.wait(lambda: send(1.0, 0.0) or ear.last[0] < -1.0, 60.0, lambda: 'no force')
        withheld = Withheld([run.processes['controller'].pid, os.getpid()], (WATCHER,))
        start, at = len(ear.came), time.monotonic()
        run.wait(lambda: send(-1.0, 3.0) or ear.last[0] > 1.0, 60.0, lambda: 'it is not followed')
        assert time.monotonic() - at - withheld() < 0.5
        assert 'went back by' in run.processes['controller'].output()
        # one step on the way to idle tells of it; nothing was answered before
        assert ear.last[0] > 0.0
        assert len(ear.forces(start)) <= 5


@pytest.mark.real_time
def test_idle_is_the_input_of_the_equilibrium_where_that_is_asked_for():
    """For a submersible, that is to hover: said last, assumed and held by the plant."""
    nodes = ('plant', 'estimator', 'controller')
    overrides = {'idle_input': 'equilibrium', 'run_until': 1e6}
    with Run('submersible', overrides, lockstep=False, nodes=nodes) as run:
        hover = run.scenario.model.equilibrium.input
        assert hover.any()
        topic = run.scenario.input.topic
        run.wait(lambda: len(run.recorder.raw[topic]) > 50, 20.0, lambda: 'no input')
        assert run.change_state('controller', 'deactivate')
        run.spin(0.3)
        np.testing.assert_allclose(run.recorder[topic].values[-1], hover, rtol=1e-12)
        said = lambda: run.diagnostics['plant'].message  # noqa: E731
        run.wait(lambda: "it is the equilibrium's" in said(), 60.0, said)
        depths = run.recorder['ground_truth'].values[-50:, :3]
        assert np.abs(np.diff(depths, axis=0)).max() < 0.05


@pytest.mark.real_time
def test_a_sensor_whose_clock_runs_ahead_is_named():
    with Run(lockstep=False, nodes=('estimator',)) as run:
        position = run.node.create_publisher(PoseWithCovarianceStamped, 'position', 10)
        velocity = run.node.create_publisher(TwistWithCovarianceStamped, 'velocity', 10)
        both = ((position, PoseWithCovarianceStamped()), (velocity, TwistWithCovarianceStamped()))

        def send():
            for (publisher, message), ahead in zip(both, (0.0, 0.6)):
                write_stamp(message.header.stamp, time.time_ns() + round(ahead * 1e9))
                publisher.publish(message)

        said = lambda: run.diagnostics['estimator'].message  # noqa: E731
        named = lambda: 'ahead of the clock: velocity by 0.' in said()  # noqa: E731
        run.wait(lambda: send() or named(), 10.0, said)
        assert 'position by' not in said()
        log = run.processes['estimator'].output()
        assert 'stamps are ahead of the clock: velocity by 0.' in log
