# SPDX-License-Identifier: Apache-2.0
"""A reading on its way to an estimate, and that to a force, as CONTRIBUTING has it."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry

import kalman_ros
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator.node import EstimatorNode

PACKAGE = Path(kalman_ros.__file__).parent
PAGE = Path(__file__).parents[2] / 'CONTRIBUTING.md'
#: Modules that are entered at all, with what keeps count and what computes; fewer is better.
MOST_MODULES = 34
#: What the timer of the diagnostics calls, which may fire while a message is on its way.
TIMERS = 'nodes/middleware/connections', 'nodes/middleware/diagnostics'


def listed(title):
    """Return the steps of a section of the page: module and function of each."""
    section = PAGE.read_text().partition(f'## {title}\n')[2].partition('\n## ')[0]
    return re.findall(r'^\d+\. `([\w/]+)\.(\w+)`:', section, re.MULTILINE)


def traced(found, publish, count):
    """Return the module and function of each call that a message makes, in order.

    It is the shortest of a few, without the diagnostics: a timer may fire on the way.
    """
    walks = []

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == 'call' and PACKAGE in path.parents:
            module = path.relative_to(PACKAGE).with_suffix('').as_posix()
            if module not in TIMERS:
                walks[-1].append((module, frame.f_code.co_name))

    for number in range(1, 9):  # what is done for the first time takes other ways
        walks.append([])
        sys.setprofile(note if number >= 4 else None)
        try:
            publish()
            found.until(lambda n=number: count() >= n, 'a message was not taken')
        finally:
            sys.setprofile(None)
    return min(walks[3:], key=lambda calls: len({module for module, _ in calls}))


def followed(steps, calls):
    """Assert that the calls pass through the steps in their order."""
    at = 0
    for step in steps:
        assert step in calls[at:], f'{step} is not called after {calls[at - 1]}'
        at = calls.index(step, at) + 1


def test_a_reading_walks_as_the_page_says(pair):
    steps = listed('One reading, step by step')
    assert len(steps) == 12
    assert len({module for module, _ in steps}) == len(steps)
    found = pair(EstimatorNode, rest_until_input='false')
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    counts, message = found.node._online.counts['velocity'], TwistWithCovarianceStamped()
    message.twist.covariance[:] = np.eye(6).ravel()

    def publish():
        write_stamp(message.header.stamp, found.node.get_clock().now().nanoseconds)
        velocity.publish(message)

    calls = traced(found, publish, counts.total)
    followed(steps, calls)
    assert len({module for module, _ in calls}) <= MOST_MODULES


@pytest.mark.slow
def test_an_estimate_walks_as_the_page_says(pair):
    steps = listed('One estimate, step by step')
    assert len(steps) == 7
    found = pair(ControllerNode)
    estimates = found.publisher(Odometry, 'estimate')
    forces, message = [], Odometry()
    found.peer.create_subscription(WrenchStamped, 'force', forces.append, 10)
    found.until(lambda: found.node._output.listeners, 'no subscriber of force')
    found.until(lambda: found.node._meeting.over, 'it waits for others')
    message.pose.covariance[:] = message.twist.covariance[:] = np.eye(6).ravel()
    message.header.frame_id = 'map'

    def publish():
        write_stamp(message.header.stamp, found.node.get_clock().now().nanoseconds)
        estimates.publish(message)

    calls = traced(found, publish, lambda: found.node._health.answered)
    followed(steps, calls)
    assert len({module for module, _ in calls}) <= MOST_MODULES
