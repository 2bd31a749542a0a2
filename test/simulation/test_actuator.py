# SPDX-License-Identifier: Apache-2.0
"""The actuator agrees with the theory of sampled plants with a delay."""

import numpy as np
import pytest

from kalman_ros.control.delay import sampled_plant
from kalman_ros.core import LinearSystem, Space
from kalman_ros.simulation.actuator import Actuator
from kalman_ros.simulation.simulated_plant import SimulatedPlant

A, B = np.array([[0.0, 1.0], [-2.0, 0.3]]), np.array([[0.0], [1.5]])
STATE, INPUT = Space(('x', 'v'), ('m', 'm/s')), Space(('u',), ('N',))
INPUTS = np.random.default_rng(0).normal(size=(40, 1))


def states(delay, gain=1.0, disturbance=None):
    system = LinearSystem(A, B, np.zeros((2, 2)), STATE, INPUT)
    plant = SimulatedPlant(system, {}, 10.0, np.array([1.0, 0.0]), 0)
    plant.actuator.adopt(np.array([gain]), delay)
    found = []
    for u in INPUTS:
        found.append(plant.state)
        plant.step(u, disturbance)
    return np.array(found)


@pytest.mark.parametrize('delay', [0.0, 0.03, 0.1, 0.26])
def test_gain_and_delay_are_those_of_theory(delay):
    system = LinearSystem(A, B, np.zeros((2, 2)), STATE, INPUT)
    theory = sampled_plant(system, np.eye(2), 0.1, delay)
    x = np.zeros(len(theory.A))
    x[0] = 1.0
    expected = []
    for u in INPUTS:
        expected.append(theory.C @ x)
        x = theory.A @ x + theory.B @ (0.7 * u)
    np.testing.assert_allclose(states(delay, 0.7), expected, atol=1e-12)


def test_a_disturbance_is_neither_scaled_nor_late():
    pushed = states(0.1, 0.0, np.array([2.0])) - states(0.1, 0.0)
    G = LinearSystem(A, B, np.zeros((2, 2)), STATE, INPUT).sampled(0.1).G
    np.testing.assert_allclose(pushed[1], 2.0 * G[:, 0], atol=1e-12)


def test_a_delay_that_grows_holds_the_oldest_input():
    actuator = Actuator(np.ones(1))
    list(actuator(np.array([1.0]), 0.1))
    list(actuator(np.array([2.0]), 0.1))
    actuator.adopt(np.ones(1), 0.5)
    acting = [float(u[0]) for told in (3.0, 4.0, 5.0) for _, u in actuator(np.array([told]), 0.1)]
    assert acting == [1.0, 1.0, 1.0]
