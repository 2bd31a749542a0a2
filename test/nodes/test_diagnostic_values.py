# SPDX-License-Identifier: Apache-2.0
"""What is not known yet is left out of the diagnostics."""

from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time

from kalman_ros.nodes.middleware.diagnostics import Diagnostics, Level


def published(values):
    """Return the values that a node publishes, by their names."""
    sent = []
    clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))
    node = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(published=0, publish=sent.append),
        create_timer=lambda *_, **__: None,
        steady=None,
        account=dict,
        get_clock=lambda: clock,
        get_fully_qualified_name=lambda: '/node',
        get_logger=lambda: None,
        subscriptions=(), publishers=(), watched=(),
    )  # fmt: skip
    Diagnostics(node, lambda: (Level.OK, 'consistent', values)).publish()
    return {found.key: found.value for found in sent[0].status[0].values}


def test_nan_leaves_no_node():
    found = published({'nis': nan, 'numpy': np.float64(nan), 'rate': 0.0})
    assert found == {'rate': '0', 'reports': '0'}


def test_other_values_stay():
    found = published({'a': inf, 'b': 'nan of a text', 'c': 1, 'd': None})
    assert found == {'a': 'inf', 'b': 'nan of a text', 'c': '1', 'd': 'None', 'reports': '0'}
