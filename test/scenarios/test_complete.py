# SPDX-License-Identifier: Apache-2.0
"""Nothing is judged that is not complete: the recorder takes part in the turns, and counts."""

import os
import subprocess

import numpy as np
import pytest
from thorough import thorough

pytest.importorskip('rclpy')

from std_msgs.msg import Float64MultiArray

from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.harness import NodeError, Run
from kalman_ros.harness import run as harness_run
from kalman_ros.nodes.middleware.topics import on_topic
from kalman_ros.simulation import closed_loop

#: Longer than the writers' 1000 samples last in the fastest loop.
_STOPPED = 3.0


class Stop:
    """Stops this process, the threads of the middleware included, once a run is under way."""

    def __init__(self):
        self.process = None

    def __call__(self, seconds):
        if seconds > 0.5 and self.process is None:
            stop, go = (f'kill -{name} {os.getpid()}' for name in ('STOP', 'CONT'))
            self.process = subprocess.Popen(['sh', '-c', f'{stop}; sleep {_STOPPED}; {go}'])


@pytest.mark.thorough
@pytest.mark.timeout(180)
def test_a_recorder_that_gets_no_processor_for_seconds_loses_nothing():
    with Run('level', seed=3) as run:
        stop = Stop()
        run.advance(40.0, stop)
        assert stop.process.wait() == 0
        found = run.trajectory()
        readings = len(run.recorder.raw['reading'])
    alone = closed_loop.run(run.scenario, None, 40.0, 3)
    assert (len(found.time), readings) == (4001, 401)
    np.testing.assert_allclose(found.truth, alone.truth, atol=1e-12)
    np.testing.assert_allclose(found.estimate, alone.estimate, atol=1e-12)


@pytest.mark.thorough
def test_what_is_lost_nevertheless_is_an_error_with_the_counts(monkeypatch):
    with Run() as run:
        run.advance(0.5)
        run.recorder.received['/estimate'] -= 3
        monkeypatch.setattr(harness_run, '_SILENCE', 0.5)
        counts = 'the record is incomplete: /estimate 48 of 51 messages'
        with pytest.raises(NodeError, match=counts):
            run.complete()


@pytest.mark.thorough
@pytest.mark.parametrize('scenario', ['mass_spring_damper_2d', 'linear'])
def test_steps_that_are_asked_for_twice_are_recorded_once(scenario):
    """The second estimator of a plant that is in a hurry is late, so that it asks again."""
    with Run(scenario, seed=3) as run:
        run.advance(1.0)
        once = {topic: list(found) for topic, found in run.recorder.raw.items()}
    with Run(scenario, {'lockstep_timeout': 0.2}, seed=3) as run:
        run.advance(0.5)
        run.processes['estimator'].signal(19)
        run.set_parameter('run_until', 1.0)
        run.wait(
            lambda: 'no estimate' in run.diagnostics['plant'].message,
            10.0,
            lambda: 'no diagnostics',
        )
        run.processes['estimator'].signal(18)
        run.advance(0.5)
        assert {topic: list(found) for topic, found in run.recorder.raw.items()} == once


@pytest.mark.thorough
def test_a_tick_that_names_what_never_comes_does_not_stop_the_loop():
    from sensor_msgs.msg import TimeReference

    with Run(seed=3) as run:
        run.advance(0.5)
        before = run.recorder.raw['estimate'][-1]
        hostile = run.node.create_publisher(TimeReference, 'tick', 10)
        run.wait(hostile.get_subscription_count, 60.0, lambda: 'no subscriber')
        tick = TimeReference(source='position')
        tick.header.stamp.sec, tick.header.stamp.nanosec = 1, 505_000_000  # between two steps
        hostile.publish(tick)
        run.advance(0.5)
        assert run.recorder.raw['estimate'][-1] != before
        assert len(run.trajectory().time) == 101


@pytest.mark.parametrize(
    ('scale', 'says'), [thorough(1.0, 'consistent'), (0.01, 'over'), thorough(0.0, 'over')]
)
def test_the_monitor_judges_whoever_estimates(scale, says):
    overrides = {'monitor_window': 100}
    with Run('level', overrides, nodes=['monitor'], lockstep=False) as run:
        state = run.scenario.state
        writers = [
            WireWriter(SignalCodec(on_topic(state, topic)))
            for topic in ('ground_truth', 'estimate')
        ]
        publishers = [
            run.node.create_publisher(writer.message_type, topic, 1000)
            for writer, topic in zip(writers, ('ground_truth', 'estimate'))
        ]
        whole = run.node.create_publisher(Float64MultiArray, 'estimate/covariance', 1000)
        for publisher in (*publishers, whole):
            run.wait(lambda p=publisher: p.get_subscription_count() > 1, 60.0, lambda: 'deaf')
        errors = np.random.default_rng(0).normal(size=4000)
        steps = enumerate(errors, start=1)

        def judged():
            """Publish one more step, since the first may be lost, and look."""
            step, error = next(steps)
            for writer, publisher, value in zip(writers, publishers, (0.0, error)):
                publisher.publish(writer(step * 10_000_000, np.array([value])))
            whole.publish(Float64MultiArray(data=[scale]))
            return says in run.diagnostics['monitor'].message

        run.wait(judged, 15.0, lambda: run.diagnostics['monitor'].message)
        assert (says == 'over') is ('NEES' in run.diagnostics['monitor'].message)
