# SPDX-License-Identifier: Apache-2.0
"""The controller in the loop: laws, references, limits and changes while it runs."""

import os
import time

import numpy as np
import pytest
from thorough import thorough

pytest.importorskip('rclpy')

from connected import acknowledged
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

from kalman_ros.analysis.verdict import judge
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.core import options_of
from kalman_ros.harness import Run
from kalman_ros.pipeline.estimator_options import EstimatorOptions


def publish(run, kind, topic, x, y=0.0, v=0.0):
    """Publish a place and a velocity on ``topic`` once it has a subscriber."""
    publisher = run.node.create_publisher(kind, topic, 10)
    run.wait(publisher.get_subscription_count, 60.0, lambda: f'no subscriber of {topic}')
    message = kind()
    pose = message.pose if kind is PoseStamped else message.pose.pose
    pose.position.x, pose.position.y = x, y
    if kind is Odometry:
        message.twist.twist.linear.x = v
    publisher.publish(message)
    acknowledged(publisher)
    run.settle('controller')
    return publisher


def mean_place(loop, seconds=4.0):
    return loop.truth[loop.time > loop.time[-1] - seconds][:, [0, 2]].mean(axis=0)


@pytest.mark.parametrize(
    ('kind', 'topic'), [(Odometry, 'reference'), thorough(PoseStamped, 'goal')]
)
def test_it_follows_the_reference(kind, topic):
    with Run() as run:
        run.advance(1.0)
        publish(run, kind, topic, 3.0, -2.0)
        run.advance(12.0)
        np.testing.assert_allclose(mean_place(run.trajectory()), [3.0, -2.0], atol=0.15)


def test_a_reference_that_cannot_be_held_is_refused_with_a_reason():
    with Run(overrides={'reference_timeout': 0.0}) as run:
        run.advance(0.5)
        publish(run, Odometry, 'reference', 1.0, v=2.0)
        log = run.processes['controller'].output
        run.wait(lambda: 'v_x = 2' in log(), 60.0, lambda: f'no reason: {log()}')
        assert 'the old one stays' in log()
        publish(run, Odometry, 'reference', np.nan)
        run.wait(lambda: 'finite' in log(), 60.0, lambda: f'no reason: {log()}')
        run.advance(0.5)


@pytest.mark.thorough
def test_integral_action_holds_against_a_force_that_nobody_knows_of():
    places = {}
    for law in ('lqr', 'lqi'):
        overrides = {'law': law, 'model_parameters.force_noise': 1e-4}
        # of the truth: a filter that does not know the force has another error
        remaps = {'controller': {'estimate': 'ground_truth'}}
        with Run(overrides=overrides, remaps=remaps) as run:
            run.advance(0.5)
            push = run.node.create_publisher(WrenchStamped, 'disturbance', 10)
            run.wait(push.get_subscription_count, 60.0, lambda: 'no subscriber of disturbance')
            message = WrenchStamped()
            message.wrench.force.x = 1.5
            push.publish(message)
            run.spin(0.3)
            run.advance(20.0)
            places[law] = mean_place(run.trajectory())
    assert places['lqr'][0] > 0.2
    assert abs(places['lqi'][0]) < 0.02


@pytest.mark.thorough
def test_placed_poles_hold_to_their_theory():
    poles = {'regulator_poles': [-1.5, -1.5, -2.0, -2.0]}
    frequencies = {'regulator_frequencies': [1.0, -1.0, 0.0, 0.0]}
    overrides = {'law': 'placement', **poles, **frequencies}
    with Run(overrides=overrides, seed=2) as run:
        run.advance(20.0)
        judgement = judge(run.scenario, run.trajectory())
    assert all(check.passed for check in judgement.checks)
    found = sorted(c.expected.real for c in judgement.checks if c.name == 'regulator pole')
    np.testing.assert_allclose(found, [-2.0, -2.0, -1.5, -1.5], atol=1e-6)


@pytest.mark.thorough
def test_integral_action_holds_to_its_theory():
    overrides = {'law': 'lqi', 'integral_cost': [30.0]}
    with Run(overrides=overrides, seed=2) as run:
        run.advance(25.0)
        judgement = judge(run.scenario, run.trajectory())
    assert [check.name for check in judgement.checks if not check.passed] == []
    assert sum(check.name == 'regulator pole' for check in judgement.checks) == 6


def test_no_force_is_larger_or_changes_faster_than_allowed():
    limits = {'input_limit': [0.8, 0.5], 'input_rate_limit': [20.0]}
    with Run(overrides=limits) as run:
        run.advance(2.0)
        loop = run.trajectory()
        limited = lambda: run.reported('controller', 'forces limited')  # noqa: E731
        run.wait(lambda: int(limited() or 0) > 0, 60.0, lambda: f'limited: {limited()}')
    assert np.all(np.abs(loop.input).max(axis=0) <= [0.8, 0.5])
    assert np.abs(loop.input[:, 0]).max() == 0.8
    assert np.abs(np.diff(loop.input, axis=0)).max() <= 20.0 * 0.01 + 1e-12


def test_new_weights_come_without_a_bump_and_bad_ones_do_not_come():
    with Run(overrides={'initial_state': [2.0, 0.0, 0.0, 0.0]}) as run:
        run.advance(0.4)
        run.set_parameter('state_cost', [900.0, 1.0, 900.0, 1.0], 'controller')
        run.advance(4.0)
        with pytest.raises(ValueError, match='state_cost'):
            run.set_parameter('state_cost', [-1.0, 1.0, 1.0, 1.0], 'controller')
        run.advance(0.2)
        loop = run.trajectory()
    change = np.abs(np.diff(loop.input[:, 0]))
    at = round(0.4 * 100)
    assert change[at - 1 : at + 2].max() < 2.0  # the new gain alone would jump by tens
    gain = loop.input[at + 200, 0] / loop.estimate[at + 200, 0]
    assert np.isfinite(gain)


def test_disabled_it_is_silent_in_force_and_enabled_it_goes_on_smoothly():
    with Run(overrides={'initial_state': [2.0, 0.0, 0.0, 0.0]}) as run:
        client = run.node.create_client(SetBool, 'controller/enable')
        run.wait(client.service_is_ready, 60.0, lambda: 'no service')

        def enable(on):
            future = client.call_async(SetBool.Request(data=on))
            run.wait(future.done, 60.0, lambda: 'no answer')

        run.advance(0.2)
        enable(False)
        run.advance(0.3)
        enable(True)
        run.advance(1.0)
        loop = run.trajectory()
    assert not loop.input[22:50].any()
    assert np.abs(np.diff(loop.input[48:], axis=0)).max() < 1.0
    assert np.abs(loop.input[80:, 0]).max() > 1.0


@pytest.mark.thorough
def test_estimates_are_predicted_by_their_age():
    with Run(lockstep=False, only={'controller': {'predict_latency': True}}) as run:
        run.advance(3.0)
        loop = run.trajectory()
        run.spin(1.2)
        key = 'age of estimates, 50 / 90 / 99 % [ms]'
        middle = float(run.reported('controller', key).split(' / ')[0])
    assert -10.0 < middle < 100.0  # a timer may be early by less than a step
    assert np.isfinite(loop.input).all()


class Feed:
    """Sends estimates to a controller and keeps its forces."""

    def __init__(self, run):
        self.run, self.forces = run, []
        self._estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        run.node.create_subscription(WrenchStamped, 'force', self.forces.append, 100)
        run.wait(self._estimates.get_subscription_count, 60.0, lambda: 'no subscriber')
        heard = lambda: int(run.reported('controller', 'subscribers: /force') or 0)  # noqa: E731
        run.wait(lambda: heard() >= 2, 60.0, lambda: 'the controller has no subscriber')

    def send(self, x, age=0.0, variance=1e-4):
        message = Odometry()
        now = self.run.node.get_clock().now().nanoseconds
        write_stamp(message.header.stamp, now - round(age * 1e9))
        message.pose.pose.position.x = float(x)
        message.pose.covariance[0] = message.pose.covariance[7] = variance
        message.twist.covariance[0] = message.twist.covariance[7] = variance
        self._estimates.publish(message)

    def answer(self, x, **options):
        """Send an estimate and return the force that answers it."""
        count = len(self.forces)
        self.send(x, **options)
        self.run.wait(lambda: len(self.forces) > count, 60.0, lambda: 'no force')
        return self.forces[-1].wrench.force.x

    def says(self, words):
        said = lambda: self.run.diagnostics['controller'].message  # noqa: E731
        self.run.wait(lambda: words in said(), 60.0, lambda: f'{said()!r}, not {words!r}')


def alone(**parameters):
    # how long an estimate is valid is no matter here, however busy the machine is
    overrides = {'transition_time': 0.0, 'estimate_timeout': 60.0, **parameters}
    return Run(overrides=overrides, lockstep=False, nodes=('controller',))


def test_the_force_goes_to_zero_when_estimates_stop_and_comes_back_with_them():
    with alone(estimate_timeout=0.2) as run:
        feed = Feed(run)
        assert feed.answer(1.0) < -1.0
        zero = lambda: feed.forces[-1].wrench.force.x == 0.0  # noqa: E731
        run.wait(zero, 60.0, lambda: 'the force stays')
        feed.says('no estimate received')
        assert feed.answer(1.0) < -1.0
        assert 'can be used again' in run.processes['controller'].output()


@pytest.mark.parametrize(
    ('bad', 'words'),
    [
        ({'x': np.nan}, 'not finite'),
        thorough({'x': 1.0, 'variance': 9.0}, 'uncertain by 3'),
        thorough({'x': 1.0, 'variance': np.nan}, 'covariance'),
        thorough({'x': 1.0, 'variance': -1.0}, 'not positive semi-definite'),
    ],
)
def test_an_estimate_that_cannot_be_trusted_is_answered_with_zero(bad, words):
    # the covariance has to be one, with or without a limit of what is certain enough
    with alone(**({'max_std': [1.0]} if 'uncertain' in words else {})) as run:
        feed = Feed(run)
        assert feed.answer(1.0) < -1.0
        assert feed.answer(**bad) == 0.0
        log = run.processes['controller'].output
        run.wait(lambda: words in log(), 60.0, lambda: f'{log()!r}')
        assert feed.answer(1.0) < -1.0


def test_the_force_goes_to_zero_no_faster_than_its_limit_and_waits_to_be_asked():
    with alone(input_rate_limit=[20.0], resume='enable') as run:
        feed = Feed(run)
        run.wait(lambda: feed.answer(1.0) < -2.5, 60.0, lambda: 'no force')
        at = len(feed.forces)
        feed.send(np.nan)
        zero = lambda: feed.forces[-1].wrench.force.x == 0.0  # noqa: E731
        run.wait(zero, 60.0, lambda: 'the force stays')
        steps = np.diff([force.wrench.force.x for force in feed.forces[at - 1 :]])
        # a pause counts for a tenth of a second at the most
        assert np.all((steps >= 0.0) & (steps <= 20.0 * 0.1 + 1e-9))
        count = len(feed.forces)
        said = lambda: run.diagnostics['controller'].message  # noqa: E731
        run.wait(lambda: feed.send(1.0) or 'disabled' in said(), 60.0, said)
        assert len(feed.forces) == count
        assert run.call(SetBool, 'controller/enable', SetBool.Request(data=True)).success
        assert feed.answer(1.0) < 0.0


def test_estimates_that_are_older_than_the_last_are_ignored():
    with alone() as run:
        feed = Feed(run)
        for _ in range(5):
            assert feed.answer(1.0) < -1.0
            feed.send(-1.0, age=0.1)
        assert feed.answer(1.0) < -1.0
        # an idle input is of a pause of this machine, and no answer
        forces = [force.wrench.force.x for force in feed.forces if force.wrench.force.x]
        assert len(forces) == 6 and max(forces) < -1.0
        # where the next one had come, too, it was not even looked at
        keys = ('estimates ignored: older than the last', 'estimates skipped for newer ones')
        ignored = lambda: sum(int(run.reported('controller', key) or 0) for key in keys)  # noqa: E731
        run.wait(lambda: ignored() == 5, 60.0, ignored)
        assert 'went back' not in run.processes['controller'].output()


def test_what_the_estimator_accepts_the_controller_does_not_refuse():
    with alone() as run:
        feed = Feed(run)
        tolerance = options_of(EstimatorOptions)
        (most,) = (o.default for o in tolerance if o.name == 'future_tolerance')
        assert feed.answer(1.0, age=-0.95 * most) < -1.0
        assert 'ahead' not in run.processes['controller'].output()


@pytest.mark.thorough
def test_a_flood_of_nonsense_lets_it_go_no_faster_than_its_limit():
    with alone(input_rate_limit=[20.0]) as run:
        feed = Feed(run)
        for _ in range(200):
            start = time.monotonic()  # no later than when the controller answers
            if feed.answer(1.0) < -2.0:
                break
        before = feed.forces[-1].wrench.force.x
        for _ in range(50):
            after = feed.answer(np.nan)
            took = time.monotonic() - start
            assert before - 0.05 <= after <= min(before + 20.0 * took, 0.0)
        log = run.processes['controller'].output()
        assert log.count('not finite') == 1


@pytest.mark.thorough
def test_faults_that_come_and_go_do_not_fill_the_log():
    with alone() as run:
        feed = Feed(run)
        for _ in range(40):
            assert feed.answer(1.0) < 0.0
            assert feed.answer(np.nan) == 0.0
        assert len(run.processes['controller'].output().splitlines()) <= 10


@pytest.mark.parametrize('largest', [thorough(1e300), 1.7e308])
def test_no_force_is_ever_not_finite(largest):
    with alone(predict_latency=True) as run:
        feed = Feed(run)
        references = run.node.create_publisher(Odometry, 'reference', 10)
        run.wait(references.get_subscription_count, 60.0, lambda: 'no subscriber')
        message = Odometry()
        message.pose.pose.position.x = largest
        references.publish(message)
        for x in (1.0, largest, -largest, 1e150, 1.0):
            feed.answer(x, age=0.05)
        forces = [force.wrench.force.x for force in feed.forces]
        assert np.isfinite(forces).all()
        assert forces[0] < -0.5


@pytest.mark.thorough
def test_after_a_fault_it_goes_on_from_where_the_force_is():
    with alone(transition_time=2.0) as run:
        feed = Feed(run)
        steady = feed.answer(1.0)
        assert feed.answer(np.nan) == 0.0
        # elsewhere by now: yet no bump
        assert abs(feed.answer(3.0)) < 0.2 * abs(steady)
        run.wait(lambda: feed.answer(3.0) < 2.0 * steady, 20.0, lambda: 'it does not come back')


BREAKING = """
from dataclasses import replace
from functools import wraps

from kalman_ros.core import LinearSystem
from kalman_ros.scenario.wiring import system

SYSTEM = system('mass_spring_damper_2d')


class Breaking(LinearSystem):
    def step(self, x, u, dt):
        if x[0] > 5.0:
            raise RuntimeError('out of range')
        return super().step(x, u, dt)


@wraps(SYSTEM.build)
def build(**parameters):
    model = SYSTEM.build(**parameters)
    model.__class__ = Breaking
    return model


BREAKING = replace(SYSTEM, build=build)
"""


def test_a_model_that_raises_ends_the_controller_with_its_force_at_zero(monkeypatch, tmp_path):
    (tmp_path / 'breaking.py').write_text(BREAKING)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    monkeypatch.syspath_prepend(tmp_path)
    with alone(model='breaking:BREAKING', predict_latency=True) as run:
        feed, process = Feed(run), run.processes['controller']
        assert feed.answer(1.0, age=0.05) < -0.5
        feed.send(9.0, age=0.05)
        assert process.wait(10.0)
        end = time.monotonic() + 60.0
        while feed.forces[-1].wrench.force.x != 0.0 and time.monotonic() < end:
            run._context.spin(0.02)
        assert feed.forces[-1].wrench.force.x == 0.0
        assert process.exit_code == 1
        assert 'RuntimeError: out of range' in process.output()
        run.processes.clear()


@pytest.mark.thorough
def test_other_limits_do_not_make_it_forget_the_estimator():
    with alone() as run:
        feed = Feed(run)
        feed.answer(1.0, variance=1.0)
        assert feed.answer(1.0) < -1.0
        run.set_parameter('state_cost', [9.0, 1.0, 9.0, 1.0], 'controller')
        assert feed.answer(1.0) < -1.0
        assert feed.answer(1.0, variance=1.0) == 0.0


def test_a_restarted_estimator_is_noticed():
    with alone() as run:
        feed = Feed(run)
        feed.answer(1.0, variance=1.0)
        assert feed.answer(1.0) < -1.0
        assert feed.answer(1.0, variance=1.0) == 0.0
        log = run.processes['controller'].output
        run.wait(lambda: 'the estimator was reset' in log(), 60.0, log)
        assert feed.answer(1.0, variance=1.0) < -1.0
