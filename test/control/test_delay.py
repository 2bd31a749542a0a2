# SPDX-License-Identifier: Apache-2.0
"""Plants with a delayed input, against the input in continuous time."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kalman_ros.control.delay import sampled_plant
from kalman_ros.core import LinearSystem, Space

DT = 0.1
C = np.array([[1.0, 0.0], [0.0, 1.0]])
PLANT = LinearSystem(
    [[0.0, 1.0], [-4.0, -0.5]], [[0.0, 0.2], [1.0, -1.0]], np.zeros((2, 2)),
    Space(('x', 'v')), Space(('f', 'g')),
)  # fmt: skip
INPUTS = np.random.default_rng(0).normal(size=(12, 2))


def sampled(system):
    """Return the outputs at the samples, from rest."""
    state, outputs = np.zeros(len(system.A)), []
    for u in INPUTS:
        outputs.append(system.C @ state)
        state = system.A @ state + system.B @ u
    return np.array(outputs)


def continuous(delay):
    """Return the states at the samples, with an input that is held and delayed."""
    edges = np.unique(np.r_[np.arange(12) * DT, np.arange(12) * DT + delay])
    edges = edges[edges <= 11 * DT + 1e-12]
    x, states = np.zeros(2), {0: np.zeros(2)}
    for begin, end in pairwise(edges):
        index = int(np.floor((0.5 * (begin + end) - delay) / DT))
        u = INPUTS[index] if index >= 0 else np.zeros(2)
        found = solve_ivp(
            lambda t, x, u=u: PLANT.A @ x + PLANT.B @ u, (begin, end), x, rtol=1e-10, atol=1e-12
        )
        x = found.y[:, -1]
        states[round(end / DT, 6)] = x
    return np.array([states[float(k)] for k in range(12)])


@pytest.mark.parametrize('delay', [0.0, 0.03, 0.1, 0.17, 0.3])
def test_the_input_acts_after_any_delay(delay):
    system = sampled_plant(PLANT, C, DT, delay)
    np.testing.assert_allclose(sampled(system), continuous(delay), atol=1e-8)
    assert len(system.A) == 2 + 2 * int(np.ceil(delay / DT - 1e-9))
    assert system.dt == DT and not system.D.any()


def test_without_a_delay_it_acts_at_once():
    found, expected = sampled_plant(PLANT, C, DT), sampled_plant(PLANT, C, DT, 0.0)
    for name in 'ABCD':
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize(('dt', 'delay'), [(0.0, 0.1), (-0.1, 0.0), (0.1, -1e-9), (0.1, np.nan)])
def test_times_that_are_none_are_refused(dt, delay):
    with pytest.raises(ValueError, match='^dt, delay: expected dt > 0 and delay >= 0'):
        sampled_plant(PLANT, C, dt, delay)
