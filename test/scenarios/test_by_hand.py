# SPDX-License-Identifier: Apache-2.0
"""The loop as a person starts it, node by node, with seconds between."""

from functools import partial

import kill_nodes
import numpy as np
import pytest

pytest.importorskip('rclpy')

from sensor_msgs.msg import JointState
from terminals import Terminals

from kalman_ros.codecs.messages import nanoseconds
from kalman_ros.scenario import shipped

pytestmark = pytest.mark.real_time
ORDERS = [
    ('plant', 'estimator', 'controller'),
    ('plant', 'controller', 'estimator'),
    ('estimator', 'plant', 'controller'),
    ('controller', 'estimator', 'plant'),
]
FILE = ('--ros-args', '--params-file', str(shipped.file('cart_pole')))
#: A longer pole and a calmer controller than in the file: it bears 0.1 s of delay, and so a
#: machine that others use.
SLOW = ('-p', 'model_parameters.length:=3.0', '-p', 'state_cost:=[10.0, 0.0, 10.0, 0.0]')
START = [0.0, 0.0, 0.3, 0.0]


@pytest.mark.parametrize('order', ORDERS, ids='-'.join)
def test_the_pole_stays_up_in_whatever_order_the_nodes_are_started(order):
    truth, estimates = {}, {}

    def keep(found, message):
        (x, theta), (v, omega) = message.position, message.velocity
        found[nanoseconds(message.header.stamp)] = [x, v, theta, omega]

    with Terminals(*FILE, *SLOW) as nodes:
        listen = nodes.node.create_subscription
        listen(JointState, 'ground_truth', partial(keep, truth), 1000)
        listen(JointState, 'estimate', partial(keep, estimates), 1000)
        for name in order:
            nodes.start(name)
            there = partial(nodes.node.get_publishers_info_by_topic, '/diagnostics')
            count = len(nodes.processes)
            nodes.wait(lambda: len(there()) >= count, 20.0, lambda: f'no {name}')  # noqa: B023
            nodes.spin(0.8)
        moving = lambda: [*truth.values()][-1:] not in ([], [START])  # noqa: E731
        nodes.wait(moving, 20.0, lambda: 'it rests')
        nodes.spin(1.5)
    states = np.array([*truth.values()])
    held = int(np.argmax(np.any(states != START, axis=1)))
    assert np.all(states[:held] == START)
    if order[0] == 'plant':
        assert held > 50
    # the estimator has known that it rests: before the plant moves it is right
    both = [stamp for stamp in truth if stamp in estimates]
    at_rest = [stamp for stamp in both if truth[stamp] == START]
    stamp = at_rest[-1] if at_rest else both[0]
    error = np.array(truth[stamp]) - estimates[stamp]
    assert np.abs(error[[0, 2]]).max() < 0.05
    assert np.abs(error[[1, 3]]).max() < 0.5
    assert np.abs(states[:, 2]).max() < 0.7


def test_the_loop_runs_again_after_each_kill():
    """For a hundred of them run ``kill_nodes.py`` by hand."""
    loop = kill_nodes.run(6)
    assert len(loop.kills) == 6
    assert kill_nodes.faults(loop) == []
