# SPDX-License-Identifier: Apache-2.0
"""Dynamics fitted to data: how far their poles scatter."""

import numpy as np
import pytest

from kalman_ros.control.identification import fit


@pytest.mark.slow
@pytest.mark.parametrize(
    'M', [np.array([[0.9, 0.3], [0.0, 0.5]]), np.array([[0.8, 0.4], [-0.4, 0.8]])]
)
def test_poles_scatter_as_far_as_is_said(M):
    """Over many runs of one recursion; the mean of 400 squares is within 30 % by 4 sigma."""
    rng = np.random.default_rng(5)
    noise = np.array([[0.04, 0.01], [0.01, 0.02]])
    exact = np.sort_complex(np.linalg.eigvals(M).astype(complex))
    z = np.zeros((1001, 400, 2))
    for k, w in enumerate(rng.multivariate_normal(np.zeros(2), noise, (1000, 400))):
        z[k + 1] = z[k] @ M.T + w
    squares = []
    for run in z.swapaxes(0, 1):
        fitted = fit(run[:-1], run[1:])
        order = np.argsort(fitted.poles)
        off = np.abs(fitted.poles[order] - exact) / fitted.pole_deviations(noise)[order]
        squares.append(off**2)
    np.testing.assert_allclose(np.mean(squares, axis=0), 1.0, atol=0.3)


def test_noise_beside_other_inputs_counts_too():
    """The front of M is fitted together with the rest, which takes some of what is known."""
    rng = np.random.default_rng(6)
    z = rng.standard_normal((500, 1))
    both = np.hstack((z, z + 0.1 * rng.standard_normal((500, 1))))
    alone, beside = fit(z, 0.5 * z), fit(both, 0.5 * z)
    noise = np.eye(1)
    assert beside.pole_deviations(noise)[0] > 5.0 * alone.pole_deviations(noise)[0]
