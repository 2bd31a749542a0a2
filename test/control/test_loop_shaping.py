# SPDX-License-Identifier: Apache-2.0
"""H-infinity loop shaping: its formulas, its norm, and its LQG controller."""

from __future__ import annotations

from math import pi, sin

import numpy as np
import pytest

from kalman_ros.control.compensator import compensator
from kalman_ros.control.loop_shaping import loop_shaping
from kalman_ros.control.lqe import lqe
from kalman_ros.control.lqr import cost, lqr
from kalman_ros.control.state_space import StateSpace, state_space
from kalman_ros.core import DesignError


def random_plant(seed: int) -> StateSpace:
    rng = np.random.default_rng(seed)
    A, B, C = rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(2, 4))
    return state_space(A, B, C)


def norm(plant: StateSpace, K: np.ndarray, L: np.ndarray) -> float:
    """Return the largest gain from disturbances of output and input to output and input."""
    H = compensator(plant, K, L)
    (n, m), k, h = plant.B.shape, len(plant.C), len(H.A)
    A = np.block([[plant.A, -plant.B @ H.C], [H.B @ plant.C, H.A]])
    B = np.block([[np.zeros((n, k)), plant.B], [H.B, np.zeros((h, m))]])
    C = np.block([[plant.C, np.zeros((k, h))], [np.zeros((m, n)), -H.C]])
    D = np.diag([1.0] * k + [0.0] * m)
    response = StateSpace(A, B, C, D).response(np.geomspace(1e-4, 1e4, 4000))
    return float(np.linalg.norm(response, 2, axis=(1, 2)).max())


def test_double_integrator_tolerates_the_sine_of_an_eighth_of_a_half_turn() -> None:
    plant = state_space([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    design = loop_shaping(plant, np.eye(1), np.eye(1))
    assert 1.0 / design.least == pytest.approx(sin(pi / 8.0))
    assert design.stability_margin == pytest.approx(sin(pi / 8.0) / 1.1)


@pytest.mark.parametrize('seed', range(8))
def test_closed_loop_has_the_norm_gamma_and_no_less_than_the_least(seed: int) -> None:
    plant = random_plant(seed)
    design = loop_shaping(plant, np.eye(2), np.eye(2))
    value = norm(plant, design.regulator.gain, design.estimator.gain)
    assert design.least * (1.0 - 1e-3) <= value <= design.gamma * (1.0 + 1e-9)


@pytest.mark.parametrize('seed', range(8))
def test_gain_is_that_of_glover_and_mcfarlane(seed: int) -> None:
    plant = random_plant(seed)
    rng = np.random.default_rng(seed + 100)
    R, V = np.diag(rng.uniform(0.2, 5.0, 2)), np.diag(rng.uniform(0.2, 5.0, 2))
    A, B, C = plant.A, plant.B, plant.C
    design = loop_shaping(plant, R, V, beyond=1.3)
    X = lqr(A, B, cost(C.T @ np.linalg.inv(V) @ C, R, B.shape)).cost_to_go
    Z = lqe(A, C, B @ np.linalg.inv(R) @ B.T, V).covariance
    g = design.gamma
    P = g**2 * np.linalg.solve((g**2 - 1.0) * np.eye(4) - Z @ X, Z)
    np.testing.assert_allclose(design.estimator.gain, P @ C.T @ np.linalg.inv(V), rtol=1e-6)
    np.testing.assert_allclose(design.regulator.gain, np.linalg.inv(R) @ B.T @ X, rtol=1e-6)
    assert np.linalg.eigvalsh(design.noise).min() >= -1e-9 * np.linalg.norm(design.noise)


def test_far_beyond_the_least_it_is_lqg_with_noise_at_the_input() -> None:
    plant = random_plant(1)
    design = loop_shaping(plant, np.eye(2), np.eye(2), beyond=1e5)
    L = lqe(plant.A, plant.C, plant.B @ plant.B.T, np.eye(2)).gain
    np.testing.assert_allclose(design.estimator.gain, L, rtol=1e-6)


@pytest.mark.parametrize('beyond', [1.0, 0.5, float('inf'), float('nan')])
def test_gamma_must_exceed_the_least(beyond: float) -> None:
    with pytest.raises(ValueError, match=r'^beyond: expected a factor above 1, got'):
        loop_shaping(random_plant(0), np.eye(2), np.eye(2), beyond)


def test_sampled_plants_are_refused() -> None:
    plant = state_space([[0.5]], [[1.0]], [[1.0]], dt=0.1)
    with pytest.raises(ValueError, match='continuous time'):
        loop_shaping(plant, np.eye(1), np.eye(1))


def test_a_mode_that_no_reading_sees_is_named() -> None:
    plant = state_space([[0.1, 0.0], [0.0, 0.2]], [[1.0], [1.0]], [[1.0, 0.0]])
    with pytest.raises(DesignError):
        loop_shaping(plant, np.eye(1), np.eye(1))
