# SPDX-License-Identifier: Apache-2.0
"""The estimator alone, fed over topics: what it accepts, when it speaks, what it reports."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from kalman_ros.codecs.messages import nanoseconds, write_stamp
from kalman_ros.harness import Run

#: Standard deviation of the positions that are sent.
SIGMA = 0.05


class Feed:
    """Sends positions to an estimator and keeps its estimates."""

    def __init__(self, run):
        self.run = run
        self.position = run.node.create_publisher(PoseWithCovarianceStamped, 'position', 10)
        self.pose = run.node.create_publisher(PoseWithCovarianceStamped, 'initialpose', 10)
        self.estimates = []
        run.node.create_subscription(Odometry, 'estimate', self.estimates.append, 100)
        for publisher in (self.position, self.pose):
            run.wait(
                publisher.get_subscription_count, 10.0, lambda: 'the estimator has not subscribed'
            )
        # the recorder and this: what is said before is lost
        heard = lambda: int(run.reported('estimator', 'subscribers: /estimate') or 0)  # noqa: E731
        run.wait(lambda: heard() >= 2, 60.0, lambda: 'the estimator has no subscriber')

    def now(self):
        return self.run.node.get_clock().now().nanoseconds

    def send(self, x, y=0.0, publisher=None, std=SIGMA, stamp=None):
        message = PoseWithCovarianceStamped()
        write_stamp(message.header.stamp, self.now() if stamp is None else stamp)
        message.pose.pose.position.x, message.pose.pose.position.y = float(x), float(y)
        message.pose.covariance[0] = message.pose.covariance[7] = std**2
        (publisher or self.position).publish(message)

    def answer(self, x, **options):
        """Send a position and return the estimate that answers it."""
        count = len(self.estimates)
        self.send(x, **options)
        self.run.wait(lambda: len(self.estimates) > count, 60.0, lambda: 'no estimate')
        return self.estimates[-1]

    def reported(self, key, wanted):
        """Wait until the estimator says ``wanted`` of ``key``; fail with what it said instead."""
        said = lambda: self.run.reported('estimator', key)  # noqa: E731
        self.run.wait(lambda: said() == wanted, 60.0, lambda: f'{key}: {said()!r}, not {wanted!r}')


def alone(**parameters):
    # no controller is there to set anything in motion
    told = {'rest_until_input': False, **parameters}
    return Run(overrides=told, lockstep=False, nodes=('estimator',))


def test_gates_and_noise_change_live_and_rejections_are_counted():
    with alone(**{'position.covariance_from': 'configuration', 'initial_std': [0.1] * 4}) as run:
        feed = Feed(run)
        first = feed.answer(3.0).pose.pose.position.x
        assert first > 1.0  # without a gate anything passes
        run.set_parameter('position.gate', 0.999, 'estimator')
        feed.answer(first)
        assert abs(feed.answer(500.0).pose.pose.position.x) < 10.0
        feed.reported('position: rejected: outside the gate', '1')
        run.set_parameter('position.noise', [1e4, 1e4], 'estimator')
        assert abs(feed.answer(500.0).pose.pose.position.x) < 10.0
        feed.reported('position: rejected: outside the gate', '1')
        with pytest.raises(ValueError, match=r'position\.gate'):
            run.set_parameter('position.gate', 1.5, 'estimator')
        with pytest.raises(ValueError, match=r'position\.noise'):
            run.set_parameter('position.noise', [0.0, 1.0], 'estimator')
        feed.reported('position: fused', '3')
        feed.reported('position: readings', '4')


def test_no_change_leaves_a_growing_mode_unseen():
    speed = {
        'kind': 'linear', 'C': [0.0, 1.0], 'noise': [0.1], 'rate': 20.0, 'topic': 'speed',
        'type': 'sensor_msgs/JointState', 'fields': ['position[v]'],
    }  # fmt: skip
    overrides = {f'speed.{name}': value for name, value in speed.items()}
    overrides |= {
        'model_parameters.A': [0.5, 0.0, 0.0, -1.0], 'sensors': ['position', 'speed'],
    }  # fmt: skip
    with Run('linear', overrides, lockstep=False, nodes=('estimator',)) as run:
        run.set_parameter('speed.enabled', False, 'estimator')
        with pytest.raises(ValueError, match='no sensor sees the growing mode'):
            run.set_parameter('position.enabled', False, 'estimator')
        run.set_parameter('position.noise', [0.2], 'estimator')


def test_initialpose_moves_the_belief_and_a_bad_one_does_not():
    with alone() as run:
        feed = Feed(run)
        feed.answer(0.0)
        feed.send(40.0, -7.0, feed.pose, std=0.01)
        log = run.processes['estimator'].output
        run.wait(lambda: 'initialpose' in log(), 60.0, lambda: 'initialpose was not taken')
        pose = feed.answer(40.0, y=-7.0).pose
        np.testing.assert_allclose(
            [pose.pose.position.x, pose.pose.position.y], [40, -7], atol=0.1
        )
        assert pose.covariance[0] < 0.011**2
        feed.send(np.nan, 0.0, feed.pose)
        run.wait(lambda: 'expected finite' in log(), 60.0, lambda: 'no warning of a bad pose')
        assert abs(feed.answer(40.0).pose.pose.position.x - 40.0) < 0.1


def test_states_are_set_by_name_and_poses_on_the_topic_of_robot_localization():
    with alone() as run:
        feed = Feed(run)
        feed.answer(0.0)
        create, log = run.node.create_publisher, run.processes['estimator'].output
        states = create(JointState, 'estimator/set_state', 10)
        poses = create(PoseWithCovarianceStamped, 'set_pose', 10)
        heard = lambda: states.get_subscription_count() and poses.get_subscription_count()  # noqa: E731
        run.wait(heard, 60.0, lambda: 'nobody subscribes')
        states.publish(JointState(name=['x', 'v_x'], position=[30.0, 0.0], effort=[0.01, 0.01]))
        feed.reported('resets', '1')
        assert abs(feed.answer(30.0).pose.pose.position.x - 30.0) < 0.1
        feed.send(-20.0, 0.0, poses, std=0.01)
        feed.reported('resets', '2')
        assert abs(feed.answer(-20.0).pose.pose.position.x + 20.0) < 0.1
        states.publish(JointState(name=['nose'], position=[1.0]))
        run.wait(lambda: 'set_state: name: expected' in log(), 60.0, lambda: 'no warning')
        feed.send(0.0, 0.0, poses, std=1e150)
        run.wait(lambda: 'no filter can compute with' in log(), 60.0, lambda: 'no warning')
        assert abs(feed.answer(-20.0).pose.pose.position.x + 20.0) < 0.1


def test_a_fixed_rate_predicts_to_now():
    with alone(publish_rate=50.0) as run:
        feed = Feed(run)
        assert not feed.estimates
        feed.send(0.5)
        run.wait(lambda: len(feed.estimates) >= 30, 60.0, lambda: 'no estimates at a fixed rate')
        stamps = np.array([nanoseconds(e.header.stamp) for e in feed.estimates]) * 1e-9
        assert abs(np.median(np.diff(stamps)) - 0.02) < 0.005
        variances = [e.pose.covariance[0] for e in feed.estimates]
        assert variances[-1] > 2.0 * variances[0]  # nothing came since: less and less is known


def test_late_readings_are_fused_over_topics():
    with alone(window=10.0) as run:
        feed = Feed(run)
        start = feed.now()
        stamps = [start - 1_000_000 * age for age in (400, 300, 100, 200, 0)]
        for stamp in stamps:
            estimate = feed.answer(1.0, stamp=stamp)
        assert nanoseconds(estimate.header.stamp) == start
        feed.reported('position: fused', '5')
        feed.answer(1.0, stamp=start + 10_000_000)
        feed.send(9.0, stamp=start - 30_000_000_000)
        feed.reported('position: dropped: older than the window', '1')


def test_it_says_how_often_and_how_late():
    with alone() as run:
        feed = Feed(run)
        rate = lambda: float(run.reported('estimator', 'position: rate [Hz]') or 0.0)  # noqa: E731
        run.wait(lambda: feed.answer(0.0) and rate() > 1.0, 60.0, lambda: f'{rate()} Hz')
        key = 'from arrival to publication, 50 / 90 / 99 % [ms]'
        run.wait(lambda: run.reported('estimator', key), 60.0, lambda: 'no latency')
        low, middle, high = map(float, run.reported('estimator', key).split(' / '))
        assert 0.0 < low <= middle <= high < 1000.0
