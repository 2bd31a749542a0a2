# SPDX-License-Identifier: Apache-2.0
"""The worst of a loop over a box: what is found is reached, and what is bounded holds."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from kalman_ros.control.performance import NoisyLoop
from kalman_ros.control.state_space import StateSpace
from kalman_ros.control.worst_case import stability_limit, worst_cost, worst_peak
from kalman_ros.core import Array

pytestmark = pytest.mark.slow

ONE = np.eye(1)


def first_order(pole: float) -> NoisyLoop:
    return NoisyLoop(np.array([[pole]]), ONE, ONE, 0.5, True)


def random_loops(rng: np.random.Generator, d: int, n: int = 4) -> tuple[Array, Array]:
    """Return A and its derivatives by d parameters; all are stable in -1 to 1."""
    A = rng.normal(size=(n, n))
    A *= 0.7 / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.normal(size=(d, n, n)) * 0.05


def test_first_order_loop_has_the_cost_and_the_peak_of_the_textbook() -> None:
    low, high = np.array([-0.2]), np.array([0.8])
    cost = worst_cost(lambda p: first_order(p[0]), low, high)
    assert cost.reached == pytest.approx(1.0 / (1.0 - 0.64) + 0.5)
    assert cost.reached <= cost.bound <= 1.1 * cost.reached
    assert cost.point == pytest.approx([0.8])

    def system(p: Array) -> StateSpace:
        return StateSpace(p.reshape(1, 1), ONE, ONE, np.zeros((1, 1)), 1.0)

    peak = worst_peak(system, low, high)
    assert peak.reached == pytest.approx(5.0)
    assert peak.reached <= peak.bound <= 5.5


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('d', [1, 2])
def test_no_sample_exceeds_the_bound_of_the_cost(seed: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    A, slopes = random_loops(rng, d)
    C, W = rng.normal(size=(2, 4)), np.eye(4)

    def loop(p: Array) -> NoisyLoop:
        return NoisyLoop(A + np.tensordot(np.sin(p), slopes, 1), C, W, 0.0, True)

    worst = worst_cost(loop, -np.ones(d), np.ones(d))
    samples = [loop(p).cost for p in rng.uniform(-1.0, 1.0, (400, d))]
    assert max(samples) <= worst.bound <= 1.1 * worst.reached
    assert max(samples) <= worst.reached * (1.0 + 1e-9)
    assert loop(worst.point).cost == pytest.approx(worst.reached)


@pytest.mark.parametrize('seed', range(6))
def test_no_sample_exceeds_the_bound_of_the_peak(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, slopes = random_loops(rng, 2)
    B, C, D = rng.normal(size=(4, 1)), rng.normal(size=(1, 4)), rng.normal(size=(1, 1))

    def loop(p: Array) -> StateSpace:
        return StateSpace(A + np.tensordot(p, slopes, 1), B * (1.0 + 0.1 * p[0]), C, D, 1.0)

    worst = worst_peak(loop, -np.ones(2), np.ones(2))
    at = np.linspace(0.0, np.pi, 400)
    samples = [np.abs(loop(p).response(at)).max() for p in rng.uniform(-1.0, 1.0, (100, 2))]
    assert max(samples) <= worst.bound <= 1.1 * worst.reached
    assert max(samples) <= worst.reached * (1.0 + 1e-6)


def test_states_that_neither_input_nor_output_reach_do_not_matter() -> None:
    def loop(p: Array) -> StateSpace:
        A = np.diag([p[0], 0.99, -0.5])
        B, C = np.array([[1.0], [1.0], [0.0]]), np.array([[1.0, 0.0, 1.0]])
        return StateSpace(A, B, C, np.zeros((1, 1)), 1.0)

    worst = worst_peak(loop, np.array([0.0]), np.array([0.5]))
    assert worst.reached == pytest.approx(2.0)
    assert worst.bound <= 2.2


def test_a_pocket_of_unstable_loops_between_the_corners_is_found() -> None:
    def loop(p: Array) -> NoisyLoop:
        return first_order(1.05 - 4.0 * (p[0] - 0.3) ** 2)

    assert all(abs(loop(np.array([p])).A[0, 0]) < 1.0 for p in (0.0, 0.5, 1.0))
    worst = worst_cost(loop, np.array([0.0]), np.array([1.0]))
    assert worst.reached == inf
    assert worst.point == pytest.approx([0.3], abs=0.12)
    limit = stability_limit(loop, np.array([0.0]), np.array([0.0]), np.array([1.0]))
    boundary = 0.3 - np.sqrt(0.05 / 4.0)
    assert limit.proved < boundary <= limit.refuted * (1.0 + 1e-5)
    assert limit.refuted < 1.1 * limit.proved


def test_limit_of_a_third_order_plant_is_that_of_its_characteristic_polynomial() -> None:
    """p1 / (s (s + p2) (s + p3)) with (s + 2) / (s + 10) (de Gaston and Safonov, 1988)."""
    nominal, widths = np.array([800.0, 4.0, 6.0]), np.array([80.0, 0.2, 0.3])

    def polynomial(p: Array) -> Array:
        plant = np.polymul([1.0, p[1], 0.0], np.polymul([1.0, p[2]], [1.0, 10.0]))
        return np.polyadd(plant, p[0] * np.array([1.0, 2.0]))

    def loop(p: Array) -> NoisyLoop:
        unit = 5.0 ** np.arange(4)
        A = np.vstack((-polynomial(p)[1:], np.eye(4)[:3]))
        A = A * unit[:, np.newaxis] / unit
        # (1 + s h / 2) / (1 - s h / 2) maps the left half plane to the unit circle
        h = 0.1 * np.eye(4)
        cayley = np.linalg.solve(np.eye(4) - h @ A, np.eye(4) + h @ A)
        return NoisyLoop(cayley, np.eye(4), np.eye(4), 0.0, True)

    limit = stability_limit(loop, nominal, nominal - widths, nominal + widths)
    low, high = 0.0, 10.0
    corner = widths * np.array([1.0, -1.0, -1.0])
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        stable = np.roots(polynomial(nominal + middle * corner)).real.max() < 0.0
        low, high = (middle, high) if stable else (low, middle)
    assert low == pytest.approx(3.4174, abs=1e-4)
    assert limit.refuted == pytest.approx(low, rel=1e-4)
    assert limit.proved < low < 1.1 * limit.proved
    lower, upper = limit.structured_singular_value
    assert lower <= 1.0 / low * (1.0 + 1e-4)
    assert 1.0 / low <= upper


def test_box_ends_where_there_is_no_loop() -> None:
    def loop(p: Array) -> NoisyLoop:
        if not p[0] > 0.0:
            raise ValueError('mass: expected a positive number')
        return first_order(0.5 / (1.0 + p[0]))

    limit = stability_limit(loop, np.array([1.0]), np.array([0.5]), np.array([1.5]))
    assert limit.refuted == inf
    assert limit.proved == pytest.approx(1.9, rel=1e-2)
    assert limit.structured_singular_value[0] == 0.0


def test_what_a_parabola_does_not_show_is_not_missed() -> None:
    """At the corners and in the middle the pole is nearly zero, between them 0.95."""

    def loop(p: Array) -> NoisyLoop:
        return first_order(0.95 * np.sin(3.0 * p[0]))

    def system(p: Array) -> StateSpace:
        A = loop(p).A
        return StateSpace(A, ONE, ONE, np.zeros((1, 1)), 1.0)

    low, high = np.array([-1.0]), np.array([1.0])
    cost, peak = worst_cost(loop, low, high), worst_peak(system, low, high)
    assert cost.reached == pytest.approx(1.0 / (1.0 - 0.95**2) + 0.5, rel=1e-3)
    assert cost.bound >= 1.0 / (1.0 - 0.95**2) + 0.5
    assert peak.bound >= 20.0
    limit = stability_limit(loop, np.array([0.0]), low, high)
    assert limit.proved >= 1.0


def test_no_bound_is_named_while_boxes_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = np.array([-0.9999]), np.array([0.9999])
    whole = worst_cost(lambda p: first_order(p[0]), low, high)
    monkeypatch.setattr('kalman_ros.control.worst_case._MOST_BOXES', 1)
    begun = worst_cost(lambda p: first_order(p[0]), low, high)
    assert whole.bound < inf
    assert begun.bound == inf
    assert begun.reached == pytest.approx(whole.reached)


def test_where_there_is_no_loop_none_is_stable() -> None:
    def loop(p: Array) -> NoisyLoop:
        if p[0] > 0.5 and abs(p[1]) < 0.2:
            raise ValueError('no loop')
        return first_order(0.3)

    limit = stability_limit(loop, np.zeros(2), -np.ones(2), np.ones(2))
    assert limit.refuted == pytest.approx(0.5, rel=1e-3)
    assert limit.proved <= limit.refuted
