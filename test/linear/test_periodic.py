# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from kalman_ros.core import DesignError
from kalman_ros.linear import periodic
from kalman_ros.linear.periodic import Phase, Readings, periodic_filter, updated

F, Q = np.array([[1.0, 0.1], [-0.2, 0.9]]), np.diag([0.01, 0.2])
POSITION = Readings(np.array([[1.0, 0.0]]), np.array([[0.04]]))
SPEED = Readings(np.array([[0.0, 1.0]]), np.array([[0.3]]))
BOTH = Readings(np.eye(2), np.diag([0.04, 0.3]))
NONE = Readings(np.zeros((0, 2)), np.zeros((0, 0)))


def test_one_phase_is_the_algebraic_equation():
    found = periodic_filter([Phase(F, Q, POSITION)])
    P = solve_discrete_are(F.T, POSITION.C.T, Q, POSITION.R)
    np.testing.assert_allclose(found.prior[0], P, rtol=1e-9)


def test_a_reading_every_third_step_is_the_algebraic_equation_of_three_steps():
    found = periodic_filter([Phase(F, Q, NONE), Phase(F, Q, NONE), Phase(F, Q, POSITION)])
    F_3, Q_3 = F @ F @ F, Q + F @ Q @ F.T + F @ F @ Q @ F.T @ F.T
    P = solve_discrete_are(F_3.T, POSITION.C.T, Q_3, POSITION.R)
    np.testing.assert_allclose(found.prior[-1], P, rtol=1e-9)
    assert [L.shape for L in found.gains] == [(2, 0), (2, 0), (2, 1)]


def test_sensors_in_turn_leave_the_same_error_as_both_together():
    still = np.eye(2), np.zeros((2, 2))
    turns = periodic_filter([Phase(F, Q, POSITION), Phase(*still, SPEED)])
    together = periodic_filter([Phase(F, Q, BOTH)])
    np.testing.assert_allclose(turns.posterior[-1], together.posterior[0], rtol=1e-9)


def test_the_solution_repeats_after_a_period():
    phases = [Phase(F, Q, POSITION), Phase(F, 3.0 * Q, NONE), Phase(F, Q, BOTH)]
    found = periodic_filter(phases)
    P = found.posterior[-1]
    for phase, expected in zip(phases, found.posterior):
        _, P = updated(phase.F @ P @ phase.F.T + phase.Q, phase.readings)
        np.testing.assert_allclose(P, expected, rtol=1e-9)


@pytest.mark.parametrize('growth', [1.0, 1.5])
def test_what_no_reading_sees_has_no_steady_state(growth):
    unseen = Phase(np.diag([0.5, growth]), np.eye(2), POSITION)
    with pytest.raises(DesignError, match='no steady state'):
        periodic_filter([unseen], periods=2000)


def test_what_is_known_exactly_settles_at_zero():
    still = periodic_filter([Phase(np.diag([0.5, 0.5]), np.zeros((2, 2)), NONE)])
    assert still.posterior.max() < 1e-20


@pytest.fixture
def updates(monkeypatch):
    """Every update of the recursion."""
    made, update = [], periodic.updated
    monkeypatch.setattr(periodic, 'updated', lambda *given: made.append(1) or update(*given))
    return made


@pytest.mark.parametrize('slow', [0.9, 0.9999, 0.9999999, 1.0])
def test_slow_modes_settle_in_a_few_steps(slow, updates):
    # at 1.0 it is the mode without a reading of its own that only noise moves
    A = np.array([[slow, 0.0], [0.1, 0.8]])
    noise = np.diag([1e-6, 0.2])
    found = periodic_filter([Phase(A, noise, NONE)] * 4 + [Phase(A, noise, SPEED)])
    assert len(updates) <= 20
    total, noises = np.eye(2), np.zeros((2, 2))
    for _ in range(5):
        total, noises = A @ total, A @ noises @ A.T + noise
    P = solve_discrete_are(total.T, SPEED.C.T, noises, SPEED.R)
    np.testing.assert_allclose(found.prior[-1], P, rtol=1e-7)


@pytest.mark.parametrize('growth', [1.0, 1.0 + 1e-6, 1.5])
def test_what_never_settles_is_refused_soon(growth, updates):
    unseen = Phase(np.diag([0.5, growth]), np.eye(2), POSITION)
    with pytest.raises(DesignError, match='no steady state'):
        periodic_filter([unseen])
    assert len(updates) <= 3000


def test_an_unstable_system_settles_as_well():
    A = np.array([[1.2, 0.3], [0.0, 1.5]])
    found = periodic_filter([Phase(A, Q, NONE), Phase(A, Q, POSITION)])
    A_2, Q_2 = A @ A, A @ Q @ A.T + Q
    P = solve_discrete_are(A_2.T, POSITION.C.T, Q_2, POSITION.R)
    np.testing.assert_allclose(found.prior[-1], P, rtol=1e-8)


def test_what_settles_step_by_step_does_so_where_rounding_keeps_the_maps_from_it(monkeypatch):
    monkeypatch.setattr(periodic, '_MOST_LEFT', 0)
    found = periodic_filter([Phase(F, Q, POSITION)])
    P = solve_discrete_are(F.T, POSITION.C.T, Q, POSITION.R)
    np.testing.assert_allclose(found.prior[0], P, rtol=1e-9)


def test_a_given_gain_is_kept_and_its_error_is_that_of_lyapunov():
    L = np.array([[0.1, 0.02], [0.0, 0.3]])
    phase = Phase(F, Q, Readings(BOTH.C, BOTH.R, L))
    found = periodic_filter([phase])
    np.testing.assert_array_equal(found.gains[0], L)
    J = np.eye(2) - L
    P = solve_discrete_lyapunov(J @ F, J @ Q @ J.T + L @ BOTH.R @ L.T)
    np.testing.assert_allclose(found.posterior[0], P, rtol=1e-9)
    # many periods at once are those one by one
    step = J @ (F @ BOTH.R @ F.T + Q) @ J.T + L @ BOTH.R @ L.T
    np.testing.assert_allclose(periodic._map_of(phase)(BOTH.R), step, rtol=1e-12)
    twice = periodic._map_of(phase).then(periodic._map_of(Phase(F, Q, POSITION)))
    expected = updated(F @ step @ F.T + Q, POSITION)[1]
    np.testing.assert_allclose(twice(BOTH.R), expected, rtol=1e-9)


def test_gains_that_let_the_error_grow_have_no_steady_state():
    away = Readings(BOTH.C, BOTH.R, -0.2 * np.eye(2))
    with pytest.raises(DesignError, match='no steady state'):
        periodic_filter([Phase(F, Q, away)])
