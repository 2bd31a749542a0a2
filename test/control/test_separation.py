# SPDX-License-Identifier: Apache-2.0
"""The statistics of the LQG loop, against simulation and against each other."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from kalman_ros.control.identification import fit
from kalman_ros.control.lqe import dlqe
from kalman_ros.control.lqr import cost, sampled_cost, sampled_lqr
from kalman_ros.control.separation import LqgLoop, optimal_cost
from kalman_ros.control.state_space import static
from kalman_ros.core import DesignError, LinearSystem, Space
from kalman_ros.core.model import Transition
from kalman_ros.linear.periodic import Readings
from kalman_ros.linear.structure import continuous_poles

DT = 0.05


def oscillator():
    return LinearSystem(
        [[0.0, 1.0], [-2.0, -0.2]],
        [[0.0], [1.0]],
        np.diag([0.0, 0.3]),
        Space(('x', 'v'), ('m', 'm/s')),
        Space(('f',), ('N',)),
    )


def both_rates():
    """A position at every other step, a speed at every step."""
    slow = Readings(np.array([[0.0, 1.0]]), np.array([[0.2]]))
    both = Readings(np.eye(2), np.diag([0.01, 0.2]))
    return [slow, both]


@pytest.fixture(scope='module')
def loop():
    system, weights = oscillator(), cost([5, 1], [0.5], (2, 1))
    design = sampled_lqr(system, weights, DT)
    sample = sampled_cost(system, weights, DT)
    return LqgLoop(system.sampled(DT), both_rates(), static(design.gain, DT)), design, sample


def test_constant_readings_give_the_steady_state_filter():
    system = oscillator()
    step, readings = system.sampled(DT), Readings(np.array([[1.0, 0.0]]), np.array([[0.04]]))
    design = dlqe(step.F, readings.C, step.Q, readings.R)
    found = LqgLoop(step, [readings], static(np.zeros((1, 2)), 0.1))
    np.testing.assert_allclose(found.posterior[0], design.covariance, rtol=1e-9)
    np.testing.assert_allclose(np.sort(found.estimator_poles), np.sort(design.poles), rtol=1e-6)


def test_the_cost_of_the_stationary_loop_is_the_lqg_optimum(loop):
    loop, design, sample = loop
    average = loop.average(loop.cost_weight(sample)[np.newaxis], 1000)[0]
    optimum = optimal_cost(loop.step, design.gain, design.cost_to_go, sample, loop.posterior)
    np.testing.assert_allclose(average.mean, optimum, rtol=1e-9)


def test_the_poles_of_the_loop_are_those_of_regulator_and_estimator(loop):
    loop, design, _ = loop
    over = loop._transitions[1] @ loop._transitions[0]
    together = np.concatenate((loop.regulator_poles**2, loop.estimator_poles**2))
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(over)), np.sort_complex(together), atol=1e-10
    )
    np.testing.assert_allclose(np.sort(design.poles), np.sort(loop.regulator_poles), rtol=1e-9)


def simulate(loop, runs, steps, rng):
    """Return (x, e) (steps, runs, 2n) of stationary runs."""
    n = len(loop.step.F)
    root = np.linalg.cholesky(loop.covariance[-1])
    z = rng.normal(size=(runs, 2 * n)) @ root.T
    rows = []
    for step in range(steps):
        phase = step % len(loop.schedule)
        noise = np.linalg.cholesky(loop._noises[phase] + 1e-15 * np.eye(2 * n))
        z = z @ loop._transitions[phase].T + rng.normal(size=z.shape) @ noise.T
        rows.append(z)
    return np.array(rows)


@pytest.mark.slow
def test_averages_scatter_as_predicted(loop):
    loop, _, sample = loop
    steps, runs = 400, 4000
    weights = np.stack([loop.error_weight(0), loop.nees_weight, loop.cost_weight(sample)])
    z = simulate(loop, runs, steps, np.random.default_rng(0))
    phases = np.arange(steps) % 2
    for M, expected in zip(weights, loop.average(weights, steps)):
        averages = np.einsum('tri,tij,trj->r', z, M[phases], z) / steps
        assert abs(averages.mean() - expected.mean) < 4.5 * expected.std / np.sqrt(runs)
        assert abs(averages.std() / expected.std - 1.0) < 0.08


@pytest.mark.slow
def test_a_fit_recovers_the_regulator(loop):
    loop, *_ = loop
    z = simulate(loop, 1, 20_000, np.random.default_rng(1))[:, 0]
    found = fit(z[:-1], z[1:, :2])
    distance = found.distance(loop.regulator_matrix, loop.step.Q)
    assert 0.5 < distance / 8 < 2.5
    s, exact = (
        np.sort_complex(continuous_poles(poles, DT))
        for poles in (found.poles, loop.regulator_poles)
    )
    np.testing.assert_allclose(s, exact, atol=0.15)
    wrong = loop.regulator_matrix + 0.05
    assert found.distance(wrong, loop.step.Q) / 8 > 10.0


def test_an_error_that_nothing_bounds_is_refused():
    system = LinearSystem([[1.0]], [[1.0]], [[1.0]], Space(('x',), ('m',)), Space(('u',), ('',)))
    blind = Readings(np.zeros((0, 1)), np.zeros((0, 0)))
    with pytest.raises(DesignError, match='no steady state'):
        _ = LqgLoop(system.sampled(0.1), [blind], static(np.array([[3.0]]), 0.1)).posterior


def test_the_sampled_cost_is_the_integral_of_the_continuous_one():
    system, weights = oscillator(), cost([5, 1], [0.5], (2, 1))
    sample = sampled_cost(system, weights, DT)
    x, u = np.array([0.7, -0.4]), np.array([1.3])
    nodes, shares = np.polynomial.legendre.leggauss(12)
    expected = 0.0
    for node, share in zip(nodes, shares):
        y = system.step(x, u, 0.5 * DT * (node + 1.0))
        expected += 0.5 * DT * share * (y @ weights.state @ y + u @ weights.input @ u)
    z = np.concatenate((x, u))
    np.testing.assert_allclose(z @ sample.weight @ z, expected, rtol=1e-12)


def test_fast_sampling_approaches_the_continuous_design():
    from kalman_ros.control.lqr import lqr

    system, weights = oscillator(), cost([5, 1], [0.5], (2, 1))
    continuous = lqr(system.A, system.B, weights)
    np.testing.assert_allclose(sampled_lqr(system, weights, 1e-5).gain, continuous.gain, rtol=1e-4)


def spread_by_brute_force(loop, M, steps):
    """Return mean and deviation of an average, from the covariance of the whole run at once."""
    size, p = len(loop.covariance[0]), len(loop.schedule)
    C = np.zeros((steps * size, steps * size))
    for k in range(steps):
        block = loop.covariance[k % p]
        for later in range(k, steps):
            rows, columns = (
                slice(later * size, (later + 1) * size),
                slice(k * size, (k + 1) * size),
            )
            C[rows, columns], C[columns, rows] = block, block.T
            block = loop._transitions[(later + 1) % p] @ block
    W = block_diag(*(M[k % p] for k in range(steps))) / steps
    return np.trace(W @ C), np.sqrt(2.0 * np.trace(W @ C @ W @ C))


@pytest.mark.parametrize('steps', [1, 2, 3, 7, 40])
def test_an_average_over_few_steps_is_that_of_the_whole_run(loop, steps):
    """Every pair of steps counts once: the lagged ones 2 (N - lag) times, not 2 N times."""
    loop, _, sample = loop
    varying = loop.error_weight(1) * np.array([1.0, 3.0])[:, np.newaxis, np.newaxis]
    weights = np.stack([loop.error_weight(0), loop.cost_weight(sample), varying])
    for M, found in zip(weights, loop.average(weights, steps)):
        np.testing.assert_allclose(
            (found.mean, found.std), spread_by_brute_force(loop, M, steps), rtol=1e-9
        )


@pytest.mark.parametrize('unit', [1e-4, 1e4])
def test_the_spread_of_an_average_does_not_depend_on_the_unit_of_the_state(loop, unit):
    """A square of the state in other units scatters by the square of the unit."""
    loop, *_ = loop
    step, readings = loop.step, loop.schedule
    other = LqgLoop(
        Transition(step.F, step.G / unit, step.Q / unit**2),
        [Readings(each.C, each.R / unit**2) for each in readings],
        static(unit * loop.regulator.D, DT),
    )
    for found, scaled in zip(*(each.average(weights(each), 30) for each in (loop, other))):
        np.testing.assert_allclose(scaled.mean * unit**2, found.mean, rtol=1e-6)
        np.testing.assert_allclose(scaled.std * unit**2, found.std, rtol=1e-6)


def weights(loop):
    """Return the weights of the squares of a state and of an error."""
    return np.stack([loop.state_weight(0), loop.error_weight(1)])
