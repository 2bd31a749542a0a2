# SPDX-License-Identifier: Apache-2.0
"""The shortest vector within limits: against non-negative least squares, and daqp."""

import numpy as np
import pytest
from scipy.optimize import nnls

from kalman_ros.control import least_distance
from kalman_ros.control.least_distance import InfeasibleError, LateError, LeastDistance, has_daqp

SOLVERS = [False, pytest.param(True, marks=pytest.mark.skipif(
    not has_daqp(), reason='daqp is not installed'))]  # fmt: skip


def random_problem(seed):
    rng = np.random.default_rng(seed)
    n, r = rng.integers(1, 12), rng.integers(1, 40)
    A = rng.normal(size=(r, n))
    softness = np.where(rng.random(r) < 0.5, 10.0 ** rng.uniform(-4, 0, r), 0.0)
    return A, softness, rng.normal(size=r) + 0.7


def by_least_squares(A, softness, b):
    """C. Lawson and R. Hanson, Solving Least Squares Problems, 1974, chapter 23."""
    E = np.vstack((-A.T, np.diag(np.sqrt(softness)), -b))
    f = np.append(np.zeros(len(E) - 1), 1.0)
    y, left = nnls(E, f)
    if left < 1e-8:
        return None
    residual = E @ y - f
    return residual[: A.shape[1]] / -residual[-1]


@pytest.mark.parametrize('compiled', SOLVERS)
def test_it_is_the_solution_of_the_dual_by_least_squares(compiled):
    solved = 0
    for seed in range(200):
        A, softness, b = random_problem(seed)
        expected = by_least_squares(A, softness, b)
        problem = LeastDistance(A, softness, compiled=compiled)
        if expected is None:
            with pytest.raises(InfeasibleError):
                problem.solve(b)
            continue
        solved += 1
        found = problem.solve(b)
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(found.z, expected, atol=1e-7 * scale)
        again = problem.solve(b, found.active)  # from its own limits
        np.testing.assert_allclose(again.z, found.z, atol=1e-9 * scale)
    assert solved > 100


@pytest.mark.parametrize('compiled', SOLVERS)
def test_any_limits_are_a_start(compiled):
    rng = np.random.default_rng(5)
    for seed in range(100):
        A, softness, b = random_problem(seed)
        softness = np.maximum(softness, 1e-3)
        problem = LeastDistance(A, softness, compiled=compiled)
        expected = problem.solve(b).z
        some = np.flatnonzero(rng.random(len(b)) < 0.3).tolist()
        np.testing.assert_allclose(problem.solve(b, some).z, expected, atol=1e-9)


def test_within_the_limits_it_is_zero():
    found = LeastDistance(np.eye(3), np.zeros(3), compiled=False).solve(np.array([0.0, 1.0, 2.0]))
    assert not found.z.any() and found.active == ()


@pytest.mark.parametrize('compiled', SOLVERS)
def test_a_soft_limit_is_exceeded_at_its_price(compiled):
    # minimise z^2 + s^2 / d with z <= -1 + s: z = -1 / (1 + d)
    for d in (1e-6, 0.1, 2.0):
        found = LeastDistance(np.eye(1), np.array([d]), compiled=compiled).solve(np.array([-1.0]))
        np.testing.assert_allclose(found.z, [-1.0 / (1.0 + d)], rtol=1e-9)


@pytest.mark.parametrize('compiled', SOLVERS)
def test_limits_that_contradict_each_other_are_infeasible(compiled):
    problem = LeastDistance(np.array([[1.0], [-1.0]]), np.zeros(2), compiled=compiled)
    with pytest.raises(InfeasibleError, match='no input keeps the limits'):
        problem.solve(np.array([-1.0, -1.0]))


@pytest.mark.parametrize('compiled', SOLVERS)
def test_limits_that_depend_on_each_other_are_solved(compiled):
    A = np.array([[1.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    found = LeastDistance(A, np.zeros(4), compiled=compiled).solve(np.array([-1.0, -2.0, -4, 1.0]))
    np.testing.assert_allclose(found.z, [-2.0, 0.0], atol=1e-8)


def test_after_the_deadline_there_is_no_solution():
    problem = LeastDistance(np.eye(2), np.zeros(2), compiled=False)
    with pytest.raises(LateError):
        problem.solve(np.array([-1.0, -2.0]), deadline=0.0)


def test_too_many_steps_are_late(monkeypatch):
    monkeypatch.setattr(least_distance, '_MOST', 0)
    with pytest.raises(LateError):
        LeastDistance(np.eye(2), np.zeros(2), compiled=False).solve(np.array([-1.0, -2.0]))


def hard_problem(seed):
    """Return limits of which a third nearly depend on others, and prices up to 1e8."""
    rng = np.random.default_rng(seed)
    n, r = int(rng.integers(4, 40)), int(rng.integers(10, 120))
    A = rng.normal(size=(r, n))
    k = r // 3
    near = 10.0 ** rng.uniform(-6, -2) * rng.normal(size=(k, n))
    A[:k] = A[k : 2 * k] * rng.uniform(0.5, 2.0, (k, 1)) + near
    softness = np.where(rng.random(r) < 0.5, 10.0 ** rng.uniform(-8, 0, r), 0.0)
    return A, softness, rng.normal(size=r) + 1.5


@pytest.mark.skipif(not has_daqp(), reason='daqp is not installed')
def test_both_solvers_agree_on_hard_problems():
    solved = 0
    for seed in range(100):
        A, softness, b = hard_problem(seed)
        answers = []
        for compiled in (True, False):
            try:
                answers.append(LeastDistance(A, softness, compiled=compiled).solve(b).z)
            except InfeasibleError:
                answers.append(np.full(A.shape[1], np.inf))
        solved += np.isfinite(answers[0]).all()
        scale = max(1.0, np.abs(answers[0]).max()) if np.isfinite(answers[0]).all() else 1.0
        np.testing.assert_allclose(answers[0], answers[1], rtol=0.0, atol=1e-10 * scale)
    assert solved > 90


@pytest.mark.parametrize('compiled', SOLVERS)
def test_a_solution_keeps_the_conditions_of_karush_kuhn_and_tucker(compiled):
    for seed in range(40):
        A, softness, b = hard_problem(seed)
        try:
            found = LeastDistance(A, softness, compiled=compiled).solve(b)
        except InfeasibleError:
            continue
        rows = [*found.active]
        E = np.hstack((A[rows], np.diag(np.sqrt(softness[rows]))))
        y = np.linalg.lstsq(E, b[rows], rcond=None)[0]  # the shortest at these limits
        scale = max(1.0, np.abs(found.z).max())
        np.testing.assert_allclose(found.z, y[: A.shape[1]], atol=2e-7 * scale)
        others = np.setdiff1d(np.arange(len(b)), rows)
        assert (A[others] @ found.z - b[others]).max(initial=0.0) < 1e-8 * scale


@pytest.mark.parametrize('compiled', SOLVERS)
@pytest.mark.parametrize('factor', [1e-8, 1e-4, 1e4, 1e8])
def test_units_do_not_matter(compiled, factor):
    """The same problem with z, some rows, or all bounds in other units."""
    for seed in range(20):
        A, softness, b = random_problem(seed)
        softness = np.maximum(softness, 1e-6)
        expected = LeastDistance(A, softness, compiled=compiled).solve(b).z
        scale = max(1.0, np.abs(expected).max())
        of_z = LeastDistance(A / factor, softness / factor**2, compiled=compiled).solve(b).z
        np.testing.assert_allclose(of_z / factor, expected, atol=1e-9 * scale)
        units = np.where(np.arange(len(b)) % 2, factor, 1.0)
        rows = LeastDistance(A * units[:, None], softness * units**2, compiled=compiled)
        np.testing.assert_allclose(rows.solve(b * units).z, expected, atol=1e-9 * scale)
        of_b = LeastDistance(A, softness, compiled=compiled).solve(b * factor).z
        np.testing.assert_allclose(of_b / factor, expected, atol=1e-9 * scale)
