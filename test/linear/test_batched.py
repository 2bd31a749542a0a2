# SPDX-License-Identifier: Apache-2.0
"""Products and series for stacks, against one matrix at a time."""

import numpy as np
import pytest

from kalman_ros.linear.batched import factor, log_determinant, product, product_transposed
from kalman_ros.linear.discretize import noise_integral


def stack(rng, members, rows, columns):
    """Return matrices (members, rows, columns), with the members last in memory."""
    return rng.normal(size=(rows, columns, members)).transpose(2, 0, 1)


@pytest.mark.parametrize('members', [3, 400])
@pytest.mark.parametrize('one', ['left', 'right', 'neither'])
def test_products_of_stacks_are_those_of_their_members(members, one):
    rng = np.random.default_rng(3)
    A, B = stack(rng, members, 2, 4), stack(rng, members, 4, 3)
    if one == 'left':
        A = A[0]
    if one == 'right':
        B = B[0]
    pairs = zip(np.broadcast_to(A, (members, 2, 4)), np.broadcast_to(B, (members, 4, 3)))
    expected = np.array([a @ b for a, b in pairs])
    assert product(A, B) == pytest.approx(expected, rel=1e-13, abs=1e-13)
    transposed = product_transposed(A, B.swapaxes(-1, -2))
    assert transposed == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_the_noise_of_a_large_stack_is_as_exact_as_that_of_each_member():
    # oscillators in units that make their norm pessimistic, where the series ends early; the
    # noise of one is a million times less than that of the others, one integrates alone, and one
    # fills the bound
    rng = np.random.default_rng(4)
    members = 300
    A, W = np.zeros((2, 4, 4, members))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[3, 2], A[1, 2] = -30.0, 30.0, rng.normal(size=members)
    A[:, :, 7] = np.eye(4, k=1)
    A[:, :, 8] = -30.0 * np.eye(4)
    W[1, 1] = W[3, 3] = rng.uniform(0.5, 1.0, members)
    W[:, :, 5] *= 1e-12
    A, W = A.transpose(2, 0, 1), W.transpose(2, 0, 1)
    found = noise_integral(A, W, 0.01)
    for member in range(members):
        alone = noise_integral(A[member], W[member], 0.01)
        scale = np.sqrt(np.outer(alone.diagonal(), alone.diagonal()))
        assert np.abs(found[member] - alone).max() <= 1e-13 * scale.max()
        assert found[member].diagonal() == pytest.approx(alone.diagonal(), rel=1e-9, abs=0.0)


@pytest.mark.parametrize('k', [1, 2, 3])
@pytest.mark.parametrize('members', [3, 400])
def test_the_log_determinant_of_a_stack_is_that_of_its_members(members, k):
    A = stack(np.random.default_rng(4), members, k, k)
    S = A @ A.swapaxes(-1, -2) + 0.1 * np.eye(k)
    expected = [np.linalg.slogdet(one)[1] for one in S]
    np.testing.assert_allclose(log_determinant(factor(S)), expected, rtol=1e-9, atol=1e-9)
