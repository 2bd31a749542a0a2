# SPDX-License-Identifier: Apache-2.0
"""A reading on its way through the estimator, as CONTRIBUTING has it."""

import re
import sys
from pathlib import Path

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped

import kalman_ros
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.nodes.estimator.node import EstimatorNode

PACKAGE = Path(kalman_ros.__file__).parent
PAGE = Path(__file__).parents[2] / 'CONTRIBUTING.md'
#: Modules that are entered at all, with what keeps count and what computes; fewer is better.
MOST_MODULES = 33


def listed():
    """Return the steps of the page: module and function of each."""
    section = PAGE.read_text().partition('## One reading, step by step\n')[2].partition('\n## ')[0]
    return re.findall(r'^\d+\. `([\w/]+)\.(\w+)`:', section, re.MULTILINE)


def traced(found):
    """Return the module and function of each call that a reading makes, in order.

    It is the shortest of a few: a timer of the node may fire while a reading is on its way.
    """
    velocity = found.publisher(TwistWithCovarianceStamped, 'velocity')
    counts, message = found.node._online.counts['velocity'], TwistWithCovarianceStamped()
    message.twist.covariance[:] = np.eye(6).ravel()
    walks = []

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == 'call' and PACKAGE in path.parents:
            module = path.relative_to(PACKAGE).with_suffix('').as_posix()
            walks[-1].append((module, frame.f_code.co_name))

    for number in range(1, 9):  # what is done for the first time takes other ways
        walks.append([])
        write_stamp(message.header.stamp, found.node.get_clock().now().nanoseconds)
        sys.setprofile(note if number >= 4 else None)
        try:
            velocity.publish(message)
            found.until(lambda n=number: counts.total() >= n, 'a reading was not taken')
        finally:
            sys.setprofile(None)
    return min(walks[3:], key=lambda calls: len({module for module, _ in calls}))


def test_the_walk_is_the_one_of_the_page(pair):
    steps = listed()
    assert len(steps) == 12
    modules = [module for module, _ in steps]
    assert len({*modules}) == len(modules)
    calls = traced(pair(EstimatorNode, rest_until_input='false'))
    at = 0
    for step in steps:
        assert step in calls[at:], f'{step} is not called after {calls[at - 1]}'
        at = calls.index(step, at) + 1
    assert len({module for module, _ in calls}) <= MOST_MODULES
