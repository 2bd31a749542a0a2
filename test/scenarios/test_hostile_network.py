# SPDX-License-Identifier: Apache-2.0
"""Strangers in the ROS domain: bytes that are no messages, services, and too much of all."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from connected import acknowledged
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from tools.soak.machine import usage

from kalman_ros.codecs.messages import message_type
from kalman_ros.harness import NodeError, Run

pytestmark = pytest.mark.real_time

#: Of rclpy, of the harness, and what no node subscribes to.
NOT_OURS = ('/rosout', '/parameter_events', '/diagnostics')
BURST = Path(__file__).with_name('burst.py')


def undecodable(run):
    """Return the topics on which a node reported undecodable messages, by node."""
    return {
        node: {v.key.split(': ')[1] for v in status.values if v.key.startswith('undecodable: ')}
        for node, status in run.diagnostics.items()
    }


def heard(run):
    """Return the topics that a node reported to subscribe to, by node."""
    return {
        node: {v.key.split(': ')[1] for v in status.values if v.key.startswith('publishers: ')}
        for node, status in run.diagnostics.items()
    }


@pytest.mark.parametrize('scenario', ['mass_spring_damper_2d', 'sound_tracker'])
def test_bytes_that_are_no_message_end_no_node(scenario):
    """Truncated messages on every topic, for as long as each node takes to notice on each."""
    sim_time = {'monitor': {'use_sim_time': True}}  # that listens to /clock, too
    with Run(scenario, lockstep=False, only=sim_time) as run:
        run.set_parameter('run_until', 1e6)
        everything = set().union(*heard(run).values()) | {'/clock'}
        types = dict(run.node.get_topic_names_and_types())
        publishers = []
        for topic in everything:
            kind = message_type(types[topic][0])
            data = bytes(serialize_message(kind()))
            # no message may have room in what is left
            short = [data[: min(20, len(data) - 4)], data[:4], data[:6]]
            if topic == '/clock':
                short.append(bytes(serialize_message(Clock(clock=Time(sec=-1)))))
            publishers.append((run.node.create_publisher(kind, topic, 10), short))

        def missing():
            for publisher, short in publishers:
                for data in short:
                    publisher.publish(data)
            noticed = undecodable(run)
            return {n: topics - noticed[n] for n, topics in heard(run).items()}

        run.wait(lambda: not any(missing().values()), 40.0, lambda: f'unnoticed: {missing()}')
        # the loop goes on meanwhile
        before = run.recorder['estimate'].stamp.size

        def went_on():
            missing()
            return run.recorder['estimate'].stamp.size > before + 100

        run.wait(went_on, 40.0, lambda: 'the estimates stopped')
        assert undecodable(run)['monitor'] > {'/clock'}
        logs = {name: process.output() for name, process in run.processes.items()}
    for name, log in logs.items():
        assert 'Traceback' not in log, (name, log)
        assert 'undecodable' in log


def test_a_long_message_is_dropped_and_its_memory_comes_back():
    """Thirty of 8 MB each: learning them took minutes each, and left 300 MB."""
    own = {
        'position.type': 'sensor_msgs/JointState',
        'position.fields': ['position[a]', 'position[b]'],
        'position.topic': 'named',
        'position.reliable': True,
    }
    with Run(overrides=own, lockstep=False, nodes=('estimator',)) as run:
        process = run.processes['estimator']
        publisher = run.node.create_publisher(JointState, 'named', 1)
        run.wait(publisher.get_subscription_count, 10.0, lambda: 'no subscriber')
        before = usage(process.pid).resident
        data = bytes(serialize_message(JointState(name=['a', 'b'], position=[0.0] * 1_000_000)))
        dropped = lambda: run.reported('estimator', 'too long: /named')  # noqa: E731
        for _ in range(30):
            publisher.publish(data)
            # one after the other, so that none of them is lost
            acknowledged(publisher)
        said = f'30, the last of {len(data)} bytes'
        run.wait(lambda: dropped() == said, 60.0, lambda: f'{dropped()}, not {said}')
        grown = usage(process.pid).resident - before
        assert grown < 100_000_000, grown
        process.signal(signal.SIGTERM)
        assert process.wait(5.0)
        assert process.exit_code == 0
        run.processes.clear()


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('model', 'os:abort'),
        ('model', 'tempfile:mkdtemp'),
        ('model', 'cart_pole'),
        ('position.kind', 'os:abort'),
        ('position.type', 'this/Zen'),
        ('state.type', 'this/Zen'),
        ('recording', '/dev/zero'),
    ],
)
def test_no_service_names_code(name, value, shared):
    """Neither while it runs nor after a cleanup, when all other parameters are free."""
    if shared.state('estimator') == 'active':
        with pytest.raises(ValueError, match='read-only|names code|unknown'):
            shared.set_parameter(name, value, 'estimator')
        for transition in ('deactivate', 'cleanup'):
            assert shared.change_state('estimator', transition)
    with pytest.raises(ValueError, match=f'{name}: it names code, which counts only from the st'):
        shared.set_parameter(name, value, 'estimator')
    # what it is already is no change
    shared.set_parameter('position.kind', 'states', 'estimator')
    for transition in ('configure', 'activate'):
        assert shared.change_state('estimator', transition)


@pytest.fixture(scope='module')
def shared():
    with Run(lockstep=False, nodes=('estimator',)) as run:
        yield run


def test_a_plant_that_diverges_stops_publishing_and_a_reset_restarts_it():
    with Run(overrides={'rest_until_input': False}, lockstep=False, nodes=('plant',)) as run:
        run.set_parameter('run_until', 1e6)
        readings = lambda: run.recorder['position']  # noqa: E731
        run.wait(lambda: readings().stamp.size > 3, 10.0, lambda: 'no readings')
        run.set_parameter('model_parameters.stiffness_y', 1e300)
        status = lambda: run.diagnostics['plant']  # noqa: E731
        run.wait(lambda: status().level == DiagnosticStatus.ERROR, 10.0, lambda: status().message)
        assert 'diverged' in status().message
        run.set_parameter('model_parameters.stiffness_y', 1.0)
        count = readings().stamp.size
        values = readings().values
        assert abs(values).max() < 1e155  # and no NaN
        steps = int(run.reported('plant', 'steps'))
        run.wait(lambda: int(run.reported('plant', 'steps')) > steps + 100, 10.0, lambda: 'no')
        assert readings().stamp.size == count
        run.trigger('plant/reset')
        run.wait(lambda: readings().stamp.size > count + 3, 10.0, lambda: 'it stays silent')
        # its stamps are the time again
        assert abs(readings().stamp[-1] - time.time_ns()) < 2_000_000_000
        assert run.processes['plant'].output().count('diverged') == 1


@pytest.mark.parametrize(
    ('name', 'value'),
    [('initial_std', [1e200] * 4), ('initial_std', [1e140] * 4), ('initial_std', [1e-170] * 4)],
)
def test_an_estimator_that_could_never_publish_refuses_to_start(name, value):
    only = {'estimator': {name: value}}
    with pytest.raises(NodeError, match='the estimator died: estimator: initial_std: '):  # noqa: SIM117
        with Run(only=only, lockstep=False, nodes=('estimator',)):
            pass


@pytest.mark.parametrize('stopped', [0.0, 0.5])
def test_at_10_khz_every_message_is_accounted_for(stopped):
    """The outcomes of readings and the losses of the middleware add up to those published."""
    with Run(lockstep=False, nodes=('estimator',)) as run:
        burst = subprocess.Popen(
            [sys.executable, str(BURST), '10000', '10000'],
            env=run.environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            came = lambda: int(run.reported('estimator', 'velocity: readings') or 0)  # noqa: E731
            run.wait(lambda: came() > 100, 30.0, lambda: 'no readings')
            if stopped:
                run.processes['estimator'].signal(signal.SIGSTOP)
                run.spin(stopped)
                run.processes['estimator'].signal(signal.SIGCONT)
            run.wait(lambda: burst.poll() is not None, 60.0, lambda: 'the burst does not end')
        finally:
            burst.kill()
        sent = int(burst.communicate()[0])
        lost = lambda: int(  # noqa: E731
            run.reported('estimator', 'lost by the middleware: /velocity') or 0
        )
        run.wait(lambda: came() + lost() >= sent, 10.0, lambda: f'{came()} + {lost()} of {sent}')
        assert came() + lost() == sent
        assert not stopped or lost() > 0
