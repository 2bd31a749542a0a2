# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.core import Gaussian
from kalman_ros.nodes.monitor.pairing import Pairing


def whole(k):
    return np.array([[1.0 + k, 0.1 * k], [0.1 * k, 2.0 + k]])


def part(k):
    return Gaussian(np.full(2, float(k)), np.diag(np.diag(whole(k))))


def pairs(pair):
    return [] if pair is None else [pair]


@pytest.mark.parametrize(
    'lost', [set(), {('estimate', 1)}, {('covariance', 0)}, {('covariance', 3)}]
)
def test_each_estimate_gets_its_own_covariance_whatever_is_lost(lost):
    pairing, found = Pairing(), {}
    for k in range(6):
        if ('estimate', k) not in lost:
            found.update(pairs(pairing.estimate(k, part(k))))
        if ('covariance', k) not in lost:
            found.update(pairs(pairing.covariance(whole(k))))
    expected = set(range(6)) - {k for _, k in lost}
    assert set(found) == expected
    for k, belief in found.items():
        np.testing.assert_array_equal(belief.covariance, whole(k))


def test_covariances_may_come_first():
    pairing = Pairing()
    assert pairing.covariance(whole(0)) is None
    assert pairing.estimate(7, part(0))[0] == 7


def test_what_has_found_its_pair_is_gone():
    pairing = Pairing()
    pairing.estimate(7, part(0))
    assert pairing.covariance(whole(0))[0] == 7
    assert pairing.covariance(whole(0)) is None
    pairing.covariance(whole(1))
    assert pairing.estimate(8, part(1))[0] == 8
    assert pairing.estimate(9, part(1)) is None


def test_what_finds_no_pair_does_not_make_it_slow(monkeypatch):
    pairing, compared = Pairing(), []
    monkeypatch.setattr(np, 'array_equal', lambda a, b: compared.append(1))
    for k in range(300):
        pairing.estimate(k, part(k))
        pairing.covariance(whole(-k - 1))
    del compared[:]
    pairing.estimate(300, part(300))
    assert len(compared) == 300
