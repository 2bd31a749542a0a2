# SPDX-License-Identifier: Apache-2.0
"""Where models rest, as a person finds it, and their linear systems there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.scenario import shipped

GRAVITY = 9.81


def lift(x: Any, u: Any) -> Any:
    return [x[1], u[0] / 2.0 - GRAVITY]


def lifted(**options: Any) -> kr.Model:
    return kr.continuous_model(
        lift, [0.0, 0.001], states='z [m] v [m/s]', inputs='thrust [N]', **options
    )


def test_a_model_with_thrust_at_rest_says_so_and_is_designed_where_trim_finds_it() -> None:
    model = lifted()
    with pytest.raises(ValueError, match=r'v changes by -9\.81 in a second; .*kr\.trim\(model\)'):
        kr.lqr(model, [1, 1], 1)
    point = kr.trim(model)
    np.testing.assert_allclose(point.input, [2.0 * GRAVITY])
    np.testing.assert_allclose(point.state, [0.0, 0.0], atol=1e-12)
    resting = lifted(equilibrium=point)
    np.testing.assert_allclose(
        kr.lqr(resting, [1, 1], 1).K, kr.lqr([[0, 1], [0, 0]], [0, 0.5], [1, 1], 1).K
    )
    np.testing.assert_array_equal(resting.equilibrium.input, point.input)
    named = lifted(equilibrium={'thrust': 2.0 * GRAVITY, 'z': 3.0})
    np.testing.assert_allclose(named.equilibrium.state, [3.0, 0.0])


def test_no_loop_is_designed_about_a_point_at_which_the_model_does_not_rest() -> None:
    scenario = kr.make_scenario(lifted(), kr.sensor([1.0, 0.0], 0.01, 'height'), rate=50.0)
    with pytest.raises(kr.DesignError, match=r'^model: it does not rest .*: v changes by -9\.81'):
        kr.simulate(scenario, seconds=1.0)


def test_what_is_given_holds_and_the_rest_is_found() -> None:
    def tank(x: Any, u: Any) -> Any:  # Torricelli's outflow of two tanks
        flow = 0.5 * np.sqrt(np.abs(x) + 1e-12)
        return [u[0] - flow[0], flow[0] - flow[1]]

    model = kr.continuous_model(tank, [1, 1], states='upper lower', inputs='pump')
    point = kr.trim(model, {'upper': 4.0}, near={'lower': 1.0, 'pump': 1.0})
    np.testing.assert_allclose(point.state, [4.0, 4.0], rtol=1e-8)
    np.testing.assert_allclose(point.input, [1.0], rtol=1e-8)
    point = kr.trim(model, {'pump': 0.75}, near=([1.0, 1.0], [0.5]))
    np.testing.assert_allclose(point.state, [2.25, 2.25], rtol=1e-8)


def test_a_trimmed_car_moves_on() -> None:
    def car(x: Any, u: Any) -> Any:
        return [x[1], (u[0] - 0.4 * x[1] ** 2) / 1000.0]

    noise = [0.0, 0.1]
    model = kr.continuous_model(car, noise, states='s v', inputs='force')
    point = kr.trim(model, {'v': 20.0})
    np.testing.assert_allclose(point.input, [160.0])
    moving = kr.continuous_model(car, noise, states='s v', inputs='force', equilibrium=point)
    assert kr.lqr(moving, [1.0, 1.0], 1.0).K.shape == (1, 2)


def test_a_drift_that_the_input_can_end_is_no_rest() -> None:
    model = kr.continuous_model(lambda x, u: [u[0] + 1.0], 1.0, states='x', inputs='u')
    with pytest.raises(ValueError, match='x changes by 1 in a second'):
        kr.lqr(model, 1.0, 1.0)
    np.testing.assert_allclose(kr.trim(model).input, [-1.0])


def test_a_heavy_body_does_not_rest_at_a_wrong_thrust() -> None:
    def heavy(x: Any, u: Any) -> Any:
        return [x[1], u[0] / 1e6 - GRAVITY]

    model = kr.continuous_model(heavy, [0.0, 1.0], states='z v', inputs='thrust')
    with pytest.raises(ValueError, match='finds no rest: v changes by 5.19'):
        kr.trim(model, {'thrust': 1.5e7})
    assert kr.trim(model).input == pytest.approx(1e6 * GRAVITY)


def test_a_pole_hangs_near_its_lowest_point() -> None:
    model = kr.load('cart_pole').model
    point = kr.trim(model, near={'theta': 3.0})
    assert abs(point.state[2]) == pytest.approx(np.pi)
    A = kr.linearize(model, point).A
    assert (np.linalg.eigvals(A).real < 1e-9).all()
    assert np.linalg.eigvals(kr.linearize(model).A).real.max() > 1.0


def test_a_model_in_discrete_time_rests_where_a_step_changes_nothing() -> None:
    def falls(x: Any, u: Any) -> Any:
        return [x[0] + 0.1 * x[1], x[1] + 0.1 * (u[0] - GRAVITY)]

    model = kr.discrete_model(falls, [0, 0.1], inputs=1, period=0.1)
    with pytest.raises(ValueError, match=r'x1 changes by -0\.981 in a period'):
        kr.dlqr(model, [1, 1], 1)
    point = kr.trim(model)
    np.testing.assert_allclose(point.input, [GRAVITY])
    system = kr.linearize(model, point)
    np.testing.assert_allclose(system.F, [[1.0, 0.1], [0.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(system.G, [[0.0], [0.1]], atol=1e-9)


@pytest.mark.parametrize('name', shipped.names())
def test_every_shipped_model_rests_at_its_equilibrium(name: str) -> None:
    model = kr.load(name).model
    point = kr.trim(model)
    np.testing.assert_allclose(point.state, model.equilibrium.state, atol=1e-9)
    np.testing.assert_allclose(point.input, model.equilibrium.input, atol=1e-9)


@pytest.mark.parametrize(
    ('call', 'reason'),
    [
        (lambda: kr.trim('cart_pole'), r'^model: expected a model, got str'),
        (lambda: kr.trim(lifted(), {'w': 1.0}), r"^unknown name in given 'w'"),
        (lambda: kr.trim(lifted(), {1: 2.0}), r"^unknown name in given '1'"),
        (lambda: kr.trim(lifted(), {'thrust': 1.0}), r'^model: it finds no rest: v changes by -9'),
        (lambda: kr.trim(lifted(), {'v': np.nan}), r'^given: v: expected a finite number'),
        (lambda: kr.trim(lifted(), {'v': 'fast'}), r'^given: v: expected a number'),
        (lambda: kr.trim(lifted(), [1.0]), r'^given: expected values by name'),
        (lambda: kr.trim(lifted(), near=[1.0]), r'^near: expected a state, a state and an input'),
        (lambda: kr.trim(lifted(), near=([1.0], [1.0])), r"^near's state: expected 2 finite"),
        (lambda: lifted(equilibrium=([0, 0], [0])), r'^equilibrium: v changes by -9\.81 .*trim'),
        (lambda: lifted(equilibrium='rest'), r'^equilibrium: expected a state, '),
        (
            lambda: kr.continuous_model([[0.0]], [1.0], 1.0, equilibrium=([0], [0])),
            r'^equilibrium: expected none beside matrices',
        ),
        (lambda: kr.linearize([[1.0]]), r'^model: expected a model'),
        (lambda: kr.linearize(lifted(), {'w': 1}), r"^unknown name in point 'w'"),
    ],
)
def test_what_is_no_point_is_refused_by_name(call: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        call()


@pytest.mark.slow
def test_a_scenario_of_such_a_model_is_simulated_about_its_rest() -> None:
    model = lifted(equilibrium={'thrust': 2.0 * GRAVITY})
    sensor = kr.sensor([1.0, 0.0], 0.01, 'height')
    run = kr.simulate(kr.make_scenario(model, sensor, rate=50.0), seconds=4.0, seed=1)
    assert abs(run.input[:, 0].mean() - 2.0 * GRAVITY) < 1.0
    assert np.abs(run.truth[:, 0]).max() < 3.0


def test_a_function_is_no_model_yet():
    with pytest.raises(ValueError, match=r'got function; of a function .* kr.continuous_model\(f'):
        kr.linearize(lambda x, u: x, [0.0], [0.0])
