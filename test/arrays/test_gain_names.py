# SPDX-License-Identifier: Apache-2.0
"""Gains have the names of python-control, and agree with what they print."""

from __future__ import annotations

import numpy as np
import pytest

import kalman_ros as kr

A, B, C = [[0.0, 1.0], [0.0, -0.5]], [[0.0], [2.0]], [[1.0, 0.0]]


def test_a_gain_is_its_matrix_by_every_name() -> None:
    gain = kr.lqr(A, B, [1.0, 0.0], 1.0)
    K, S, E = gain
    for same in (gain.K, gain.gain, np.asarray(gain), gain[0]):
        np.testing.assert_array_equal(same, K)
    np.testing.assert_array_equal(gain.S, S)
    np.testing.assert_array_equal(gain.E, E)
    np.testing.assert_array_equal(gain.T, K.T)
    assert gain.shape == (1, 2)
    assert len(gain) == 3


@pytest.mark.parametrize('sampled', [False, True])
def test_an_observer_prints_the_gain_that_it_is_in_arithmetic(sampled: bool) -> None:
    found = kr.dlqe(A, C, [0.1, 0.1], 0.01) if sampled else kr.lqe(A, C, [0.1, 0.1], 0.01)
    L, P, E = found
    np.testing.assert_array_equal(found.L, L)
    np.testing.assert_array_equal(np.asarray(found), L)
    np.testing.assert_array_equal(found.P, P)
    np.testing.assert_array_equal(found.E, E)
    np.testing.assert_array_equal(found.T, L.T)
    assert found.shape == (2, 1)
    name = 'L'
    rows = [line.split() for line in repr(found).splitlines() if line.startswith(f'{name} x')]
    printed = [float(row[-1]) for row in rows]
    np.testing.assert_allclose(printed, L[:, 0], rtol=1e-3)
