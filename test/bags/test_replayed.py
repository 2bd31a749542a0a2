# SPDX-License-Identifier: Apache-2.0
"""The true poses of a recording that was replayed, by what is known of them."""

from types import SimpleNamespace

import pytest

from kalman_ros.bags.replayed import Replayed

POSES, STATES = object(), SimpleNamespace(time='time', state='state')


@pytest.mark.parametrize(
    ('poses', 'states', 'reference'),
    [
        (POSES, None, POSES),
        (POSES, STATES, POSES),
        (None, STATES, ('time', 'state', None)),
        (None, None, None),
    ],
)
def test_poses_come_before_states(poses, states, reference):
    replayed = SimpleNamespace(true_poses=poses, truth=states, _path=lambda *given: given)
    assert Replayed.reference(replayed) == reference
