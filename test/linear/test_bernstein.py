# SPDX-License-Identifier: Apache-2.0
"""Polynomials over a box: values at nodes, coefficients, and their hull."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from kalman_ros.linear.bernstein import DEGREE, at_nodes, centre, coefficients, polynomial, slopes


def quadratic(p: np.ndarray) -> np.ndarray:
    x, y = p
    return np.array([1.0 + x - 2.0 * y + 3.0 * x * y + x**2 * y**2, y**2 - x])


def test_polynomial_of_second_degree_is_exact_everywhere() -> None:
    low, high = np.array([-1.0, 0.5]), np.array([2.0, 1.5])
    grid, rest = polynomial(quadratic, low, high)
    np.testing.assert_allclose(rest, 0.0, atol=1e-12)
    t = np.linspace(0.0, 1.0, DEGREE + 1)
    expected = [quadratic(low + np.array(at) * (high - low)) for at in product(t, t)]
    np.testing.assert_allclose(at_nodes(grid, 2), expected, atol=1e-12)
    np.testing.assert_allclose(centre(grid, 2), quadratic(0.5 * (low + high)))
    middle = 0.5 * (low + high)
    across = quadratic(np.array([high[0], middle[1]])) - quadratic(np.array([low[0], middle[1]]))
    np.testing.assert_allclose(slopes(grid, 2)[0], 0.5 * across)


def test_rest_is_the_largest_difference_of_a_cubic() -> None:
    _, rest = polynomial(lambda p: p**3, np.array([-1.0]), np.array([1.0]))
    t = np.linspace(-1.0, 1.0, 2001)
    assert np.abs(rest).max() == pytest.approx(np.abs(t**3 - t).max(), rel=1e-6)


def test_values_lie_in_the_hull_of_the_coefficients() -> None:
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, DEGREE + 1)
    for _ in range(20):
        weights = rng.normal(size=(DEGREE + 1, DEGREE + 1))

        def value(x: float, y: float, w: np.ndarray = weights) -> float:
            powers = np.arange(DEGREE + 1)
            return float(x**powers @ w @ y**powers)

        found = coefficients(np.array([value(x, y) for x, y in product(t, t)]), 2)
        inside = [value(*p) for p in rng.uniform(0.0, 1.0, (200, 2))]
        assert found.min() <= min(inside)
        assert max(inside) <= found.max()
        corners = [value(*p) for p in product((0.0, 1.0), repeat=2)]
        np.testing.assert_allclose(found[[0, DEGREE, -DEGREE - 1, -1]], corners, atol=1e-9)
