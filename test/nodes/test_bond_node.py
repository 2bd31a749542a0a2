# SPDX-License-Identifier: Apache-2.0
"""A bond over topics with a manager of the same protocol, where ``bond`` is installed."""

import importlib.util
import time

import numpy as np
import pytest

from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

INSTALLED = importlib.util.find_spec('bond') is not None


class Manager:
    """A manager as Nav2's: bonds with the node that it activates, and knows when that is gone."""

    def __init__(self, found):
        from bond.msg import Status

        self._found, self._kind = found, Status
        self.heard = []
        self._publisher = found.peer.create_publisher(Status, 'bond', 5)
        self._subscription = found.peer.create_subscription(Status, 'bond', print, 100)

    def look(self):
        """Take what has come, and return whether the node says that it is active."""
        while (taken := self._subscription.handle.take_message(self._kind, False)) is not None:
            message = taken[0]
            if message.instance_id != 'manager':
                assert message.id == 'estimator' and message.heartbeat_period < 1.0
                self.heard.append((time.monotonic(), message.active))
        return bool(self.heard) and self.heard[-1][1]

    def say(self, *, active):
        self._publisher.publish(
            self._kind(id='estimator', instance_id='manager', active=active, heartbeat_timeout=4.0)
        )


@pytest.mark.skipif(not INSTALLED, reason='bond is not installed')
def test_a_manager_keeps_a_bond_with_the_node_that_it_activates(pair):
    found = pair(EstimatorNode, file=str(shipped.file('mass_spring_damper_2d')), autostart='false')
    manager = Manager(found)
    node = found.node
    assert node.trigger_configure() is not None
    found.until(lambda: True, '')
    assert not manager.heard  # an inactive node has no bond
    node.trigger_activate()
    found.until(manager.look, 'the node does not say that it is active')
    manager.say(active=True)
    start = time.monotonic()
    found.until(lambda: time.monotonic() - start > 1.5, '')
    manager.look()
    gaps = np.diff([at for at, _ in manager.heard])
    assert len(gaps) > 2 and gaps.max() < 4.0
    node.trigger_deactivate()
    found.until(lambda: not manager.look(), 'the node does not say that it is inactive')
