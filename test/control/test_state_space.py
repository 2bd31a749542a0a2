# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.linalg import expm

from kalman_ros.control.delay import sampled_plant
from kalman_ros.control.state_space import state_space
from kalman_ros.core import LinearSystem, Space


def random_system(seed, n, m, p, dt=None):
    rng = np.random.default_rng(seed)
    shapes = ((n, n), (n, m), (p, n), (p, m))
    return state_space(*(rng.normal(size=shape) for shape in shapes), dt)


def oscillator():
    return LinearSystem(
        [[0.0, 1.0], [-2.0, -0.2]],
        [[0.0], [1.0]],
        np.zeros((2, 2)),
        Space(('x', 'v'), ('m', 'm/s')),
        Space(('f',), ('N',)),
    )


def test_the_response_by_hand():
    lag = state_space([[-2.0]], [[1.0]], [[3.0]], [[0.5]])
    expected = 3.0 / (1j * np.array([0.0, 1.0, 4.0]) + 2.0) + 0.5
    np.testing.assert_allclose(lag.response([0.0, 1.0, 4.0])[:, 0, 0], expected)
    held = state_space([[0.5]], [[1.0]], [[1.0]], dt=0.2)
    z = np.exp(1j * 0.2 * np.array([0.0, 3.0]))
    np.testing.assert_allclose(held.response([0.0, 3.0])[:, 0, 0], 1.0 / (z - 0.5))


@pytest.mark.parametrize('seed', range(4))
def test_systems_are_joined_as_their_responses_are(seed):
    one, other = random_system(seed, 3, 2, 4), random_system(seed + 9, 2, 4, 2)
    s = 0.3 + 1.7j
    np.testing.assert_allclose((other @ one).at(s), other.at(s) @ one.at(s))
    loop = (other @ one).at(s)
    closed = np.linalg.solve(np.eye(2) + loop, loop)
    np.testing.assert_allclose((other @ one).closed().at(s), closed)


@pytest.mark.parametrize('seed', range(4))
def test_a_channel_sees_the_others_closed(seed):
    loop, s = random_system(seed, 4, 3, 3), 0.3 + 1.7j
    L = loop.at(s)
    rest = [0, 2]
    inner = np.linalg.solve(np.eye(2) + L[np.ix_(rest, rest)], L[rest][:, [1]])
    np.testing.assert_allclose(loop.channel(1).at(s), L[1:2, 1:2] - L[1:2][:, rest] @ inner)


@pytest.mark.parametrize('seed', range(4))
def test_closing_channel_by_channel_closes_the_loop(seed):
    loop = random_system(seed, 4, 3, 3)
    expected = np.sort_complex(loop.closed().poles)
    for index in range(3):
        found = np.sort_complex(loop.channel(index).closed().poles)
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize('delay', [0.0, 0.02, 0.05, 0.13, 0.2])
def test_a_late_input_moves_the_plant_as_integrated(delay):
    plant, dt, fine = oscillator(), 0.05, 0.005
    sampled = sampled_plant(plant, np.eye(2), dt, delay)
    assert len(sampled.A) == 2 + np.ceil(delay / dt - 1e-9)
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=40)
    step = plant.sampled(fine)
    x, late = np.zeros(2), round(delay / fine)
    state = np.zeros(len(sampled.A))
    for k, u in enumerate(inputs):
        state = sampled.A @ state + sampled.B[:, 0] * u
        for part in range(10):
            at = 10 * k + part - late
            x = step.F @ x + step.G[:, 0] * (inputs[at // 10] if at >= 0 else 0.0)
        np.testing.assert_allclose(sampled.C @ state, x, atol=1e-10)


def test_a_whole_sample_of_delay_is_one_over_z():
    plant, dt = oscillator(), 0.05
    prompt, late = (sampled_plant(plant, np.eye(2), dt, delay) for delay in (0.0, 3 * dt))
    z = np.exp(0.4j)
    np.testing.assert_allclose(late.at(z), prompt.at(z) / z**3, rtol=1e-10)
    np.testing.assert_allclose(prompt.A, expm(plant.A * dt), atol=1e-12)


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match='B: expected 2 x 1'):
        state_space(np.eye(2), [[1.0]], np.eye(2))
    with pytest.raises(ValueError, match='dt: expected a positive'):
        state_space([[1]], [[1]], [[1]], dt=0.0)
    with pytest.raises(ValueError, match='series: expected 2 outputs'):
        random_system(0, 2, 2, 2) @ random_system(0, 2, 2, 3)
    with pytest.raises(ValueError, match='I \\+ D that can be inverted'):
        state_space([[-1]], [[1]], [[1]], [[-1]]).closed()
    with pytest.raises(ValueError, match='dt, delay: expected'):
        sampled_plant(oscillator(), np.eye(2), 0.1, -0.1)
