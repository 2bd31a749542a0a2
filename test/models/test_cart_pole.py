# SPDX-License-Identifier: Apache-2.0
"""The pole on its cart: the published numbers, the laws of mechanics, and the loop."""

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.control.lqr import cost, lqr
from kalman_ros.core import linearize
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.linear.structure import eigenvalues
from kalman_ros.models.cart_pole import CartPole
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop

JOINTS = 'joint_states'


def upright():
    model = CartPole()
    return linearize(model, *model.equilibrium)


def test_its_open_loop_poles_are_the_published_ones():
    # University of Michigan, Control Tutorials: Inverted Pendulum
    poles = np.sort(eigenvalues(upright().A).real)
    np.testing.assert_allclose(poles, [-5.6041, -0.1428, 0.0, 5.5651], atol=5e-5)


def test_its_gain_is_the_published_one():
    # the same tutorial, Q = C'C with the readings x and theta, R = 1
    system = upright()
    found = lqr(system.A, system.B, cost([1, 0, 1, 0], [1], (4, 1)))
    np.testing.assert_allclose(found.gain, [[-1.0, -1.6567, 18.6854, 3.4594]], atol=5e-5)


def test_the_regulator_of_the_scenario_tends_to_the_published_gain():
    values = {'rate': 2000.0, 'state_cost': [1.0, 0.0, 1.0, 0.0]}
    found, _ = regulator(scenario.build({'model': 'cart_pole', **values}))
    np.testing.assert_allclose(found.gain, [[-1.0, -1.6567, 18.6854, 3.4594]], rtol=0.01)


def test_without_friction_it_keeps_its_energy():
    model = CartPole(friction=0.0)
    M, m, inertia, length, g = 0.5, 0.2, 0.006, 0.3, 9.8

    def energy(x):
        _, v, theta, omega = x.T
        tip = v - length * omega * np.cos(theta), length * omega * np.sin(theta)
        motion = M * v**2 + m * (tip[0] ** 2 + tip[1] ** 2) + inertia * omega**2
        return 0.5 * motion + m * g * length * np.cos(theta)

    x = np.array([[0.0, 0.3, 0.3, 12.0], [0.0, 0.0, 3.0, 1.0]])
    before = energy(x)
    for _ in range(500):
        x = model.step(x, np.zeros(1), 0.01)
    np.testing.assert_allclose(energy(x), before, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
@pytest.mark.parametrize('seed', mostly_thorough([0, 1], 1))
def test_the_loop_recovers_from_a_lean(filter, seed):
    built = scenario.build({'model': 'cart_pole'})
    assert built.initial_state[2] == 0.3
    run = closed_loop.run(built, regulator(built)[0].gain, 6.0, seed, filter=filter)
    x, _, theta, _ = run.truth.T
    assert np.abs(theta).max() < 0.5
    assert np.abs(theta[-200:]).max() < 0.15
    assert np.abs(x[-200:]).max() < 0.15
    low, high = nis_bounds(run)
    assert low < run.innovations[JOINTS].nis.mean() / 2 < high


def test_without_the_gain_it_falls():
    built = scenario.build({'model': 'cart_pole'})
    run = closed_loop.run(built, None, 2.0, 0)
    assert np.abs(run.truth[:, 2]).max() > 2.0


@pytest.mark.slow
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
def test_nothing_is_lost_where_the_angle_wraps(filter):
    values = {'initial_state': [0.0, 0.0, 0.3, 12.0], 'initial_std': [0.1, 0.1, 0.3, 3.0]}
    built = scenario.build({'model': 'cart_pole', **values})
    run = closed_loop.run(built, None, 12.0, 0, filter=filter)
    wraps = np.abs(np.diff(run.truth[:, 2])) > np.pi
    assert wraps.sum() > 18
    error = built.model.state.subtract(run.truth, run.estimate)[50:]
    assert np.all(np.abs(error[:, 2]) < 6.0 * np.sqrt(run.covariance[50:, 2, 2]))
    assert nees(error, run.covariance[50:]).mean() / 4 < 1.5
    low, high = nis_bounds(run)
    assert low < run.innovations[JOINTS].nis.mean() / 2 < high


def nis_bounds(run):
    return chi_square_bounds(1.0, 1.0 / len(run.innovations[JOINTS].nis), 1e-3)


@pytest.mark.parametrize('angle', [0.0, 0.4, -1.1, np.pi])
def test_the_noise_is_that_of_a_random_force_and_torque(angle):
    """Through the inverse of the mass matrix, whose first column is that of the input."""
    cart, pole, inertia, length, force, torque = 0.5, 0.2, 0.006, 0.3, 0.07, 0.02
    model = CartPole(force_noise=force, torque_noise=torque)
    x = np.array([0.3, -0.2, angle, 0.5])
    B = model.input_jacobian(x, np.zeros(1))[[1, 3], 0]
    coupling = pole * length * np.cos(angle)
    masses = np.array([[cart + pole, coupling], [coupling, inertia + pole * length**2]])
    G = np.linalg.inv(masses)
    if B[1] * G[1, 0] < 0.0:  # the other way of counting the angle
        G[0, 1] = G[1, 0] = -G[1, 0]
    np.testing.assert_allclose(G[:, 0], B)
    W = model.noise_density(x)[np.ix_([1, 3], [1, 3])]
    np.testing.assert_allclose(W, G @ np.diag([force, torque]) @ G.T, rtol=1e-9, atol=1e-12)
