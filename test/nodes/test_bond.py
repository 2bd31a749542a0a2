# SPDX-License-Identifier: Apache-2.0
"""The protocol of a bond with a manager, on a stand-in for its message."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware import bond


class Status(SimpleNamespace):
    """A message, as ``bond`` has it."""

    def __init__(self, **fields):
        header = SimpleNamespace(stamp=None)
        super().__init__(**{'header': header, 'heartbeat_timeout': 4.0, **fields})


class Node:
    """What a bond uses of a node; what is published is kept."""

    steady = None

    def __init__(self):
        self.sent, self.said, self.ends = [], [], []

    def create_publisher(self, kind, topic, queue):
        assert topic == 'bond'
        return SimpleNamespace(publish=lambda message: self.sent.append(message.active))

    def create_subscription(self, kind, topic, callback, queue):
        assert topic == 'bond'

    def create_timer(self, period, callback, clock):
        assert 4 * period < bond.TIMEOUT

    def at_the_end(self, action):
        self.ends.append(action)

    def get_logger(self):
        return SimpleNamespace(warning=self.said.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: None))


@pytest.fixture
def formed(monkeypatch):
    module = ModuleType('bond.msg')
    module.Status = Status
    monkeypatch.setitem(sys.modules, 'bond', ModuleType('bond'))
    monkeypatch.setitem(sys.modules, 'bond.msg', module)
    now = SimpleNamespace(seconds=100.0)
    monkeypatch.setattr(bond, 'monotonic', lambda: now.seconds)
    assert bond.has_type()
    node = Node()
    return node, bond.Bond(node, 'estimator'), now


def manager(active=True, **changes):
    return Status(**{'id': 'estimator', 'instance_id': 'manager', 'active': active, **changes})


def test_it_says_that_the_node_is_active_until_it_is_not(formed):
    node, side, _ = formed
    side.beat()
    side.receive(manager())
    side.beat()
    for end in node.ends:
        end()
    side.beat()
    assert node.sent == [True, True, False] and not node.said


def test_a_manager_with_a_patience_of_nothing_is_not_silent_at_once(formed):
    node, side, now = formed
    for _ in range(40):
        side.receive(manager(heartbeat_timeout=0.01))
        now.seconds += 0.3
        side.beat()
    assert not node.said


def test_a_manager_that_parts_is_answered_once(formed):
    node, side, now = formed
    side.receive(manager())
    side.receive(manager(active=False))
    assert node.sent == [False]
    side.beat()
    side.receive(manager(active=False))
    now.seconds += 100.0
    side.beat()
    assert node.sent == [False] and not node.said
    side.receive(manager(instance_id='another'))
    side.beat()
    assert node.sent == [False, True]


def test_a_manager_that_is_silent_is_named_and_the_node_goes_on(formed):
    node, side, now = formed
    side.receive(manager(heartbeat_timeout=2.0))
    now.seconds += 2.0
    side.beat()
    assert not node.said
    now.seconds += 0.01
    side.beat()
    side.beat()
    assert node.said == ['the manager is silent for 2 s: going on alone']
    assert node.sent == [True] * 3
    side.receive(manager(instance_id='the next'))
    now.seconds += 1.0
    side.beat()
    assert len(node.said) == 1


@pytest.mark.parametrize(
    'lie',
    [
        {'id': 'controller'}, {'instance_id': 'a liar'}, {'instance_id': ''},
        {'instance_id': None},
    ],
)  # fmt: skip
def test_nobody_else_breaks_a_bond(formed, lie):
    node, side, now = formed
    mine = side._message.instance_id
    side.receive(manager())
    lie = {key: mine if value is None else value for key, value in lie.items()}
    side.receive(manager(active=False, **lie))
    side.beat()
    assert node.sent == [True]
    now.seconds += 5.0
    side.receive(manager(**lie))  # nor is it taken for a sign of life
    side.beat()
    assert len(node.said) == 1


@pytest.mark.parametrize('timeout', [float('nan'), float('inf'), 0.0, -1.0, 1e30])
def test_an_absurd_patience_is_not_taken_over(formed, timeout):
    node, side, now = formed
    side.receive(manager(heartbeat_timeout=timeout))
    now.seconds += 4.1
    side.beat()
    assert node.said == ['the manager is silent for 4 s: going on alone']
