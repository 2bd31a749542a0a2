# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from kalman_ros.control.stability import modes

FREE = [[0.0, 1.0], [0.0, 0.0]]
SWING = [[0.0, 2.0], [-2.0, 0.0]]


def fates(A, dt=None):
    return [mode.fate for mode in modes(A, dt)]


@pytest.mark.parametrize('dt', [None, 0.01, 0.7])
@pytest.mark.parametrize(
    ('A', 'expected'),
    [
        ([[-2.0]], ['decays']),
        ([[3.0]], ['grows']),
        ([[0.0]], ['stays']),
        (np.zeros((3, 3)), ['stays'] * 3),
        (FREE, ['grows'] * 2),
        (np.eye(3, k=1), ['grows'] * 3),
        (SWING, ['stays']),
        (block_diag(SWING, SWING), ['stays'] * 2),
        (block_diag(SWING, SWING) + np.eye(4, k=2), ['grows'] * 2),
        ([[-1.0, 1.0], [0.0, -1.0]], ['decays'] * 2),
        (block_diag([[-1.0, 1.0], [0.0, -1.0]], 0.0), ['stays', 'decays', 'decays']),
        ([[0.0, 1.0], [0.0, -1e-3]], ['stays', 'decays']),
        (np.diag([0.0, -1e-5, 1.0]), ['grows', 'stays', 'decays']),
        (np.diag([-1e5, -1e-5]), ['decays'] * 2),
        (block_diag(FREE, [[0.0]], -1.0), ['grows', 'grows', 'grows', 'decays']),
    ],
)
def test_fates(A, expected, dt):
    A = np.array(A, dtype=float)
    assert fates(A if dt is None else expm(A * dt), dt) == expected


@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('size', [2, 3])
def test_a_jordan_block_is_found_in_any_coordinates(seed, size):
    rng = np.random.default_rng(seed)
    T = np.linalg.qr(rng.normal(size=(size + 2, size + 2)))[0]
    block = np.eye(size, k=1)
    A = T @ block_diag(block, [[-1.0, 0.3], [-0.3, -1.0]]) @ T.T
    assert fates(A) == ['grows'] * size + ['decays']
    assert fates(T @ block_diag(np.zeros((size, size)), -np.eye(2)) @ T.T) == (
        ['stays'] * size + ['decays'] * 2
    )


@pytest.mark.parametrize('dt', [None, 0.02])
def test_the_numbers_of_a_mode(dt):
    # x'' + 2 zeta w x' + w^2 x = 0 with w = 5, zeta = .2
    A = np.array([[0.0, 1.0], [-25.0, -2.0]])
    (mode,) = modes(A if dt is None else expm(A * dt), dt)
    np.testing.assert_allclose(mode.pole, complex(-1.0, np.sqrt(24.0)), rtol=1e-10)
    np.testing.assert_allclose(mode.time_constant, 1.0)
    np.testing.assert_allclose(mode.natural_frequency, 5.0)
    np.testing.assert_allclose(mode.damping_ratio, 0.2)
    assert str(mode) == (
        '-1 ± 4.9j 1/s decays, time constant 1 s, natural frequency 5 rad/s, damping ratio 0.2'
    )


def test_what_dies_within_a_sample():
    (mode,) = modes(np.zeros((1, 1)), 0.1)
    assert (mode.fate, mode.time_constant, mode.damping_ratio) == ('decays', 0.0, 1.0)


def test_growth_comes_first():
    poles = [mode.pole.real for mode in modes(np.diag([-1.0, 2.0, 0.0, -3.0]))]
    assert poles == [2.0, 0.0, -1.0, -3.0]
