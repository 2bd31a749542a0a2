# SPDX-License-Identifier: Apache-2.0
"""Time that is not the wall's: simulated, resting, jumping, and played again."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from rosgraph_msgs.msg import Clock

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.harness import Run

SIMULATED = {'use_sim_time': True}
SECOND = 1_000_000_000
#: Of the clock, in nanoseconds.
PERIOD = 20_000_000


class Bag:
    """Publishes a clock, and readings of a body at rest, as a bag that is played does."""

    def __init__(self, run, start=100 * SECOND):
        self.run, self.now = run, start
        create = run.node.create_publisher
        self._clock = create(Clock, '/clock', 10)
        self._position = create(PoseWithCovarianceStamped, 'position', 10)
        self._velocity = create(TwistWithCovarianceStamped, 'velocity', 10)
        self._message, self._pose, self._twist = Clock(), self._position.msg_type(), None
        self._twist = self._velocity.msg_type()
        for covariance in (self._pose.pose.covariance, self._twist.twist.covariance):
            covariance[0] = covariance[7] = 0.01

    def connect(self, *publishers_and_listeners):
        """Wait until each publisher has N subscribers."""
        for publisher, count in publishers_and_listeners:
            run = self.run
            enough = lambda: publisher.get_subscription_count() >= count  # noqa: B023, E731
            run.wait(enough, 10.0, lambda: f'{publisher.topic} has no subscriber')  # noqa: B023

    def tick(self, *, readings=True):
        """Let the clock go on by a period, with a reading of each."""
        self.now += PERIOD
        self.rest()
        if readings:
            for publisher, message in (
                (self._position, self._pose),
                (self._velocity, self._twist),
            ):
                write_stamp(message.header.stamp, self.now)
                publisher.publish(message)

    def rest(self):
        """Publish the clock as it is."""
        write_stamp(self._message.clock, self.now)
        self._clock.publish(self._message)
        self.run.spin(0.015)

    def play(self, seconds, **options):
        for _ in range(round(seconds * SECOND / PERIOD)):
            self.tick(**options)


@pytest.fixture
def loop():
    """An estimator and a controller in simulated time, with a bag for a plant."""
    nodes = ('estimator', 'controller')
    overrides = {**SIMULATED, 'transition_time': 0.0, 'estimate_timeout': 1.0}
    with Run(lockstep=False, nodes=nodes, overrides=overrides) as run:
        bag = Bag(run)
        # a node each, and the recorder for readings
        bag.connect((bag._clock, 2), (bag._position, 2), (bag._velocity, 2))
        yield run, bag


def stamps(run, topic):
    return run.recorder[topic].stamp


def finite(run):
    for topic in ('estimate', 'force'):
        assert np.isfinite(run.recorder[topic].values).all(), topic
    assert np.isfinite(run.recorder['estimate'].covariance).all()


def latencies(run):
    """Return every latency that the nodes report, in ms."""
    found = []
    for status in run.diagnostics.values():
        found += [v.value for v in status.values if '50 / 90 / 99 %' in v.key and v.value]
    return np.array([[float(number) for number in text.split(' / ')] for text in found])


def says(run, node, words):
    said = lambda: run.diagnostics[node].message  # noqa: E731
    run.wait(lambda: words in said(), 60.0, lambda: f'{said()!r}, not {words!r}')


def test_lockstep_in_simulated_time_is_the_same_to_the_last_bit():
    found = []
    for overrides in ({}, SIMULATED):
        with Run(seed=5, overrides={**overrides, 'lockstep_timeout': 10.0}) as run:
            run.advance(1.0)
            found.append((run.recorder.raw['estimate'], run.recorder.raw['force']))
    assert len(found[0][0]) == 101
    assert found[0] == found[1]


@pytest.mark.thorough
def test_an_estimator_that_has_the_full_name_of_a_topic_is_in_step():
    with Run(only={'estimator': {'position.topic': '/position'}}, seed=5) as run:
        run.advance(0.5)
        assert len(run.recorder.raw['estimate']) == 51
        fused = lambda: run.reported('estimator', 'position: fused')  # noqa: E731
        run.wait(lambda: int(fused() or 0) > 1, 60.0, fused)


@pytest.mark.real_time
def test_a_bag_that_is_played_again_restarts_the_estimator(loop):
    run, bag = loop
    for again in range(3):
        bag.now = 100 * SECOND
        bag.play(2.0)
        restarts = lambda: run.reported('estimator', 'restarts')  # noqa: E731
        log = run.processes['estimator'].output
        run.wait(lambda: restarts() == str(again), 60.0, lambda: f'{restarts()}\n{log()}')  # noqa: B023
    says(run, 'controller', 'running')
    assert 'time of the estimate went back' in run.processes['controller'].output()
    log = run.processes['estimator'].output()
    assert log.count('the clock went back by 1.9') + log.count('the clock went back by 2') == 2
    times = stamps(run, 'estimate') * 1e-9
    assert np.count_nonzero(np.diff(times) < 0.0) == 2
    assert 100.0 < times.min() < times.max() <= 102.0
    # each time it begins as uncertain as one is after a reading or two
    back = np.flatnonzero(np.diff(times) < 0.0) + 1
    variance = run.recorder['estimate'].covariance.diagonal(axis1=1, axis2=2)
    assert (variance[back] > 1.5 * variance[back - 1]).all(), variance[back]
    found = latencies(run)
    assert found.size
    assert found.min() >= 0.0
    assert found.max() < 500.0
    finite(run)


@pytest.mark.real_time
@pytest.mark.parametrize('seconds', [5.0, 1000.0])
def test_a_clock_that_jumps_ahead(loop, seconds):
    """After a short gap the belief is predicted, after a long one it is worth nothing."""
    run, bag = loop
    bag.play(2.0)
    before = run.recorder['estimate'].covariance[-1]
    bag.now += round(seconds * SECOND)
    jumped = bag.now
    bag.play(1.0)
    run.wait(lambda: stamps(run, 'estimate')[-1] == bag.now, 60.0, lambda: 'no new estimates')
    restarts = lambda: run.reported('estimator', 'restarts')  # noqa: E731
    run.wait(lambda: restarts() == ('1' if seconds > 60.0 else '0'), 60.0, restarts)
    logged = 'restarted from the initial belief' in run.processes['estimator'].output()
    assert logged == (seconds > 60.0)
    found = run.recorder['estimate']
    after = found.covariance[found.stamp >= jumped]
    assert after[0].trace() > 1.4 * before.trace()
    np.testing.assert_allclose(after[-1], before, rtol=0.5, atol=1e-6)
    says(run, 'controller', 'running')
    assert latencies(run).max() < 1e3
    finite(run)


@pytest.mark.real_time
def test_a_clock_that_rests(loop):
    """The controller's watchdog does not rest: the force is zero, said once, and goes on."""
    run, bag = loop
    bag._pose.pose.pose.position.x = 1.0
    bag.play(2.0)
    assert np.abs(run.recorder['force'].values[-1]).max() > 0.5
    for _ in range(200):
        bag.rest()
    says(run, 'controller', 'no estimate received')
    assert not run.recorder['force'].values[-1].any()
    count = len(run.recorder.raw['force'])
    for _ in range(100):
        bag.rest()
    assert len(run.recorder.raw['force']) == count
    log = run.processes['controller'].output()
    assert log.count('received for') == 1, log
    assert 'duplicate' not in run.processes['estimator'].output()
    bag.play(1.0)
    assert np.abs(run.recorder['force'].values[-1]).max() > 0.5
    says(run, 'controller', 'running')
    assert run.reported('estimator', 'restarts') == '0'
    finite(run)


@pytest.mark.real_time
def test_without_a_clock_nothing_is_trusted_and_nothing_is_absurd(loop):
    run, bag = loop
    for _ in range(50):
        bag.now += PERIOD
        write_stamp(bag._pose.header.stamp, bag.now)
        bag._position.publish(bag._pose)
        run.spin(0.01)
    says(run, 'controller', 'ahead of the clock')
    assert not run.recorder['force'].values.any()
    assert latencies(run).max() < 1e3
    bag.play(1.0)
    says(run, 'controller', 'running')
    finite(run)


@pytest.mark.real_time
def test_estimates_at_a_fixed_rate_rest_with_the_clock_and_go_back_with_it():
    overrides = {**SIMULATED, 'publish_rate': 25.0}
    with Run(lockstep=False, nodes=('estimator',), overrides=overrides) as run:
        bag = Bag(run)
        bag.connect((bag._clock, 1), (bag._position, 2), (bag._velocity, 2))
        bag.play(2.0)
        times = stamps(run, 'estimate') * 1e-9
        assert 40 <= len(times) <= 60
        np.testing.assert_allclose(np.diff(times), 0.04, atol=0.021)
        for _ in range(60):
            bag.rest()
        assert len(stamps(run, 'estimate')) <= len(times) + 1
        bag.now = 100 * SECOND
        bag.play(1.0)
        again = stamps(run, 'estimate')[len(times) + 1 :] * 1e-9
        assert len(again) >= 20
        assert 100.0 <= again.min() <= again.max() <= 101.0


@pytest.mark.real_time
def test_a_plant_follows_an_external_clock():
    """At half the pace, resting, ahead and back: its stamps are the time."""
    with Run(lockstep=False, nodes=('plant',), overrides=SIMULATED) as run:
        run.set_parameter('run_until', 1e6)
        bag = Bag(run)
        bag.connect((bag._clock, 1))
        truth = lambda: stamps(run, 'ground_truth')  # noqa: E731
        run.spin(0.3)
        assert not len(truth())  # before the clock there is no time
        bag.play(1.0, readings=False)
        first = truth()
        assert 90 <= len(first) <= 101
        assert first[0] > 100 * SECOND
        np.testing.assert_array_equal(np.diff(first), 10_000_000)
        for _ in range(60):
            bag.rest()
        assert len(truth()) <= len(first) + 1
        for there in (200 * SECOND, 100 * SECOND):
            count, bag.now = len(truth()), there
            bag.play(0.5, readings=False)
            later = truth()[count:]
            assert len(later) >= 40
            assert there - SECOND // 50 < later[-40] <= later[-1] <= there + SECOND
            assert abs(later[-1] - bag.now) < SECOND // 20
        place = run.recorder['ground_truth'].values
        assert np.abs(np.diff(place, axis=0)).max() < 0.5  # the body knows nothing of it


@pytest.mark.thorough
@pytest.mark.parametrize('lockstep', [True, pytest.param(False, marks=pytest.mark.real_time)])
def test_a_plant_that_is_restarted(lockstep):
    """In lockstep its time begins again; in real time its body is suddenly elsewhere."""
    elsewhere = {'initial_state': [3.0, 0.0, 3.0, 0.0]}
    gates = {'position.gate': 0.999, 'velocity.gate': 0.999, 'lockstep_timeout': 0.4}
    with Run(lockstep=lockstep, only={'plant': elsewhere}, overrides=gates) as run:
        run.advance(3.0)
        run.kill('plant')
        run.start('plant')
        restarts = lambda: run.reported('estimator', 'restarts')  # noqa: E731
        count = len(run.recorder.raw['ground_truth'])
        run.set_parameter('run_until', 5.0 if lockstep else 1e6)
        truth = run.recorder.raw['ground_truth']
        run.wait(lambda: len(truth) >= count + 500, 40.0, lambda: f'{len(truth) - count} steps')
        run.spin(1.5)
        if lockstep:
            assert restarts() == '1'
            assert 'time went back' in run.processes['estimator'].output()
            assert 'time of the estimate went back' in run.processes['controller'].output()
        found = run.recorder['estimate']
        last = run.recorder['ground_truth']
        at = np.flatnonzero(last.stamp == found.stamp[-1])[-1]
        error = last.values[at] - found.values[-1]
        std = np.sqrt(found.covariance[-1].diagonal())
        assert np.all(np.abs(error) < 6.0 * std)
        says(run, 'controller', 'running')
        finite(run)
