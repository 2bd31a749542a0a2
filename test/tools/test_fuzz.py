# SPDX-License-Identifier: Apache-2.0
"""Whatever comes, an estimator keeps its promises; the command `fuzz` goes on for longer."""

import numpy as np
import pytest
from thorough import mostly_thorough
from tools.fuzz.engine import _SHARES, BrokenPromiseError, Episode

from kalman_ros.core import Gaussian
from kalman_ros.estimators import FILTERS, online

SEEDS = range(100_000, 100_080)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('seed', mostly_thorough(SEEDS, *SEEDS[:2]))
def test_hostile_input_breaks_no_promise(seed):
    with np.errstate(all='ignore'):
        assert sum(1 for _ in Episode(seed).run()) == 200


@pytest.mark.slow
def test_an_estimator_that_does_not_look_is_found_out(monkeypatch):
    def careless(belief):
        return Gaussian(belief.mean, belief.covariance), 0

    monkeypatch.setattr(online, 'committed', careless)
    with np.errstate(all='ignore'), pytest.raises(BrokenPromiseError, match='seed'):
        for seed in SEEDS:
            list(Episode(seed).run())


def test_every_filter_is_tried():
    assert set(_SHARES) == set(FILTERS)
    assert sum(_SHARES.values()) == pytest.approx(1.0)


def test_robots_with_rotations_are_tried_with_the_filters_that_they_can_have():
    episodes = [Episode(seed) for seed in range(100_000, 100_080)]
    assert {each.model for each in episodes} == {'Robot3D', 'Inertial', '_Swing', 'LinearSystem'}
    # which filter a seed has depends on how many there are: any of two of the robots will do
    turning = {each.filter for each in episodes if each.model in ('Robot3D', 'Inertial')}
    assert len(turning - {'ekf'}) >= 2
