# SPDX-License-Identifier: Apache-2.0
"""What a node reports when nothing can arrive, or messages are unusable."""

import re

import pytest

pytest.importorskip('rclpy')

import rclpy
from geometry_msgs.msg import PoseStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.harness import Run


def says(run, node, *words):
    """Wait until a node says all of the words, on /diagnostics and on its console."""
    said = lambda: run.diagnostics[node].message  # noqa: E731
    logged = lambda: run.processes[node].output()  # noqa: E731
    there = lambda: all(word in said() and word in logged() for word in words)  # noqa: E731
    run.wait(there, 60.0, lambda: f'{said()!r}, {logged()!r}, not {words}')


@pytest.fixture
def driver():
    """Create a foreign node in the domain of a run."""
    contexts = []

    def make(run):
        contexts.append(rclpy.Context())
        rclpy.init(args=[], context=contexts[0], domain_id=run.domain)
        return rclpy.create_node('driver', context=contexts[0])

    yield make
    contexts[0].try_shutdown()


@pytest.mark.thorough
def test_what_cannot_arrive_is_named(driver):
    effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    reliable = {'velocity.reliable': True}
    with Run(overrides=reliable, lockstep=False, nodes=('estimator', 'controller')) as run:
        theirs = driver(run)
        theirs.create_publisher(String, 'position', 1)
        theirs.create_publisher(TwistWithCovarianceStamped, 'velocity', effort)
        says(
            run,
            'estimator',
            '/position: /driver publishes std_msgs/String, '
            'expected geometry_msgs/PoseWithCovarianceStamped',
            '/velocity: /driver publishes with another quality of service: ',
            'eliab',  # the policy, which the middleware spells as it likes
        )
        assert 'force' not in run.diagnostics['estimator'].message
        run.kill('estimator', 15)
        says(run, 'controller', '/estimate: no publishers')
        # what matches is no problem, whatever else a profile has
        assert 'quality' not in run.processes['controller'].output()


@pytest.mark.thorough
def test_readings_that_came_and_were_dropped_are_counted_with_field_and_sizes():
    overrides = {
        'position.type': 'sensor_msgs/JointState',
        'position.fields': ['position[1]', 'position[2]'],
    }
    with Run(overrides=overrides, lockstep=False, nodes=('estimator',)) as run:
        publisher = run.node.create_publisher(JointState, 'position', 10)
        run.wait(publisher.get_subscription_count, 60.0, lambda: 'no subscriber')
        message = JointState(position=[1.0, 2.0])
        write_stamp(message.header.stamp, run.node.get_clock().now().nanoseconds)
        said = lambda: run.diagnostics['estimator'].message  # noqa: E731
        trouble = 'position[2]: expected at least 3 numbers, got 2'
        # the subscription is best effort: messages before discovery are lost
        start = 'no reading could be used: '
        wanted = rf'{start}\d+ of position dropped: wrong size \({re.escape(trouble)}\)'
        send = lambda: publisher.publish(message)  # noqa: E731
        run.wait(lambda: send() or re.match(wanted, said()), 60.0, said)
        assert f'wrong size: {trouble}' in run.processes['estimator'].output()


def test_a_goal_in_another_frame_than_the_estimate_is_refused_with_both_names():
    with Run(lockstep=False, nodes=('controller',), overrides={'estimate_timeout': 0.0}) as run:
        goals = run.node.create_publisher(PoseStamped, 'goal', 10)
        estimates = run.node.create_publisher(Odometry, 'estimate', 10)
        for publisher in (goals, estimates):
            run.wait(publisher.get_subscription_count, 60.0, lambda: 'no subscriber')
        goal = PoseStamped()
        goal.header.frame_id, goal.pose.position.x = 'base_link', 2.0
        goals.publish(goal)
        log = run.processes['controller'].output
        says_so = lambda: "expected the frame 'map' of the estimate, got 'base_link'" in log()  # noqa: E731
        run.wait(says_so, 60.0, log)
        estimate = Odometry()
        estimate.header.frame_id = 'base_link'
        write_stamp(estimate.header.stamp, run.node.get_clock().now().nanoseconds)
        estimates.publish(estimate)
        force = lambda: len(run.recorder.raw['force'])  # noqa: E731
        run.wait(force, 60.0, lambda: 'no answer')
        goals.publish(goal)  # now it is the estimate's
        reference = lambda: run.reported('controller', 'reference')  # noqa: E731
        run.wait(lambda: '2.' in reference(), 60.0, reference)
