# SPDX-License-Identifier: Apache-2.0
"""`kr.worst_case` and `kr.loop_shaping` as a person uses them."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from thorough import thorough

import kalman_ros as kr
from kalman_ros.analysis.worst_case import PlantLoops, named_plants
from kalman_ros.arrays.scenarios import BELIEVED, values_of
from kalman_ros.arrays.worst_case import Worst, WorstCase
from kalman_ros.control.margins import margins
from kalman_ros.core import LinearSystem
from kalman_ros.models.mass_spring_damper import mass_spring_damper
from kalman_ros.scenario import build

pytestmark = pytest.mark.slow

CART = {'pole_mass': (0.15, 0.25), 'length': (0.25, 0.35)}


def check_samples(count: int) -> None:
    worst = kr.worst_case('cart_pole', CART)
    values = values_of('cart_pole', {}, *BELIEVED)
    scenario = build(values)
    loops = PlantLoops(scenario, named_plants(values, CART)[0])
    low, high = np.array(list(CART.values())).T
    points = np.random.default_rng(0).uniform(low, high, (count, 2))
    costs = [scenario.rate * loops.noisy(p).cost for p in points]
    assert max(costs) <= worst.cost.bound < 1.1 * worst.cost.found
    assert max(costs) <= worst.cost.found * (1.0 + 1e-6)
    disks = [margins(loops.broken(p, 0)).disk.alpha for p in points[: count // 10]]
    at = worst.disk['f']
    assert min(disks) >= at.bound > at.found / 1.1
    assert min(disks) >= at.found * (1.0 - 1e-6)


@pytest.mark.thorough
def test_samples_are_within_the_bounds() -> None:
    check_samples(30)


@pytest.mark.thorough
def test_a_hundred_thousand_samples_are_within_the_bounds() -> None:
    check_samples(100_000)


@pytest.mark.thorough
def test_margins_and_cost_are_those_of_the_worst_plant() -> None:
    worst = kr.worst_case(kr.design('cart_pole'), CART)
    assert worst.cost.point == pytest.approx({'pole_mass': 0.15, 'length': 0.25})
    assert worst.margins['f'].disk.alpha == pytest.approx(worst.disk['f'].found)
    assert worst.stable
    proved, refuted = worst.stable_times
    assert worst.structured_singular_value == (1.0 / refuted, 1.0 / proved)
    text = repr(worst)
    assert all(len(line) < 80 for line in text.splitlines())
    assert 'cost a second' in text
    assert 'Structured singular value' in text


def test_believed_plant_has_the_cost_of_the_design() -> None:
    worst = kr.worst_case('mass_spring_damper', {'mass': (0.9, 1.1)})
    design = kr.design('mass_spring_damper').report.closed_loop
    assert worst.nominal_cost == pytest.approx(design.cost, rel=0.05)


@pytest.mark.parametrize(
    ('found', 'bound', 'times', 'stable', 'structured'),
    [
        (2.0, 3.0, (0.5, 4.0), True, (0.25, 2.0)),
        (2.0, inf, (0.5, 4.0), False, (0.25, 2.0)),
        (2.0, inf, (1.0, 4.0), True, (0.25, 1.0)),
        (inf, inf, (0.0, 0.5), False, (2.0, inf)),
        (inf, 3.0, (1.0, 2.0), False, (0.5, 1.0)),
    ],
)
def test_loops_are_stable_if_a_bound_proves_it(
    found: float,
    bound: float,
    times: tuple[float, float],
    stable: bool,
    structured: tuple[float, float],
) -> None:
    worst = WorstCase({}, 1.0, Worst(found, bound, {}), {}, {}, times, None, report=None)
    assert worst.stable is stable
    assert worst.structured_singular_value == structured


def test_a_function_gives_what_names_give() -> None:
    model = mass_spring_damper()
    sensor = kr.sensor([[1.0, 0.0]], [[0.01]])
    scenario = kr.make_scenario(model, sensor, rate=50.0)
    worst = kr.worst_case(scenario, {'mass': (0.5, 2.0)}, plant=mass_spring_damper)
    assert worst.stable
    assert worst.cost.point['mass'] in (0.5, 2.0)
    with pytest.raises(ValueError, match='plant: expected a function'):
        kr.worst_case(scenario, {'mass': (0.5, 2.0)})
    with pytest.raises(ValueError, match='stifness'):
        kr.worst_case(scenario, {'stifness': (0.5, 2.0)}, plant=mass_spring_damper)


@pytest.mark.thorough
def test_an_actuator_that_is_too_strong_is_found_at_the_gain_margin() -> None:
    upper = kr.design('cart_pole').report.regulator.loops[0].estimated.margins.upper_gain.value
    worst = kr.worst_case('cart_pole', {'actuator_gain': (0.95, 1.5 * upper)})
    assert worst.cost.found == inf
    assert not worst.stable
    assert worst.unstable['actuator_gain'] == pytest.approx(upper, rel=1e-3)


@pytest.mark.parametrize(
    ('intervals', 'message'),
    [
        ({}, 'intervals: expected 1 to 3 parameters, got 0'),
        ({'mas': (1.0, 2.0)}, "unknown parameter 'mas'; did you mean 'mass'"),
        ({'mass': (2.0, 3.0)}, 'mass: expected low < high about its designed value 1, got 2 to 3'),
        ({'mass': (1.0, 1.0)}, 'mass: expected low < high'),
        ({'mass': 3}, 'mass: expected a low and a high end, got 3'),
        ({'mass': 'ab'}, "mass: expected a low and a high end, got 'ab'"),
        ({'mass': (float('nan'), 2.0)}, 'mass: expected'),
        ({'mass': (0.5, inf)}, 'mass: expected finite ends, got 0.5 and inf'),
        ({'mass': (-1.0, 2.0)}, 'mass: expected at least'),
        ({'position.noise': (0.1, 0.2)}, 'position.noise: expected the name of one number'),
        ({'initial_std.x': (0.1, 2.0)}, 'initial_std.x: expected a parameter that changes'),
        (7, 'intervals: expected ends by name'),
    ],
)
def test_wrong_intervals_are_refused_in_one_line(intervals: object, message: str) -> None:
    with pytest.raises(ValueError, match='expected|unknown') as error:
        kr.worst_case('mass_spring_damper_2d', intervals)
    assert message in str(error.value)
    assert '\n' not in str(error.value)


def test_loop_shaping_is_an_lqg_design_of_its_weights() -> None:
    A, B, C = [[0.0, 1.0], [-1.0, -0.1]], [0.0, 1.0], [1.0, 0.0]
    design = kr.loop_shaping(A, B, C, R=0.1, V=0.01)
    np.testing.assert_allclose(kr.lqr(A, B, design.state_cost, 0.1), design.regulator)
    np.testing.assert_allclose(kr.lqe(A, C, design.noise, 0.01), design.estimator)
    assert 'coprime factors' in repr(design)
    assert all(len(line) < 80 for line in repr(design).splitlines())


@pytest.mark.thorough
def test_intervals_may_be_those_of_a_fit() -> None:
    run = kr.simulate('mass_spring_damper', seconds=20.0, seed=1)
    times = {name: series.time for name, series in run.readings.items()}
    values = {name: series.values for name, series in run.readings.items()}
    fit = kr.tune(
        'mass_spring_damper', times, values, run.input, input_times=run.time, fit=['mass']
    )
    mass = fit.parameters['model_parameters.mass']
    worst = kr.worst_case('mass_spring_damper', fit)
    assert worst.intervals == {'model_parameters.mass': (1.0, mass.low, mass.high)}
    assert worst.stable


def test_an_unstable_loop_in_the_box_is_no_stable_box() -> None:
    def plant(mass: float = 1.0) -> LinearSystem:
        return mass_spring_damper(mass, damping=-30.0 if abs(mass - 1.23) < 0.015 else 0.5)

    scenario = kr.make_scenario(plant(), kr.sensor([[1.0, 0.0]], [[0.01]]), rate=50.0)
    worst = kr.worst_case(scenario, {'mass': (0.8, 1.5)}, plant=plant)
    if worst.cost.found == inf or worst.disk['f'].found == 0.0:
        assert not worst.stable
        assert worst.stable_times[1] <= 1.0
    wide = kr.worst_case(scenario, {'mass': (0.9, 1.56)}, plant=plant)  # 1.23 is its middle
    assert wide.cost.found == inf
    assert not wide.stable
    assert wide.stable_times[1] <= 1.0
    assert wide.unstable['mass'] == pytest.approx(1.23, abs=0.015)


@pytest.mark.parametrize(
    'intervals',
    [
        thorough({'damping': (0.0, 1e6)}),
        thorough({'damping': (0.0, 100.0)}),
        thorough({'mass': (0.01, 100.0)}),
        thorough({'mass': (1e-9, 1e9)}),
    ],
)
def test_wide_intervals_have_an_answer(intervals: dict[str, tuple[float, float]]) -> None:
    worst = kr.worst_case('mass_spring_damper', intervals)
    assert worst.cost.found >= worst.nominal_cost
    assert worst.cost.bound >= worst.cost.found


def test_a_sensor_at_half_the_rate_counts_as_one_with_twice_the_noise() -> None:
    noise = 0.02
    base = {'model': 'cart_pole', 'joint_states.noise': [noise, noise]}

    def cost(changes: dict[str, object]) -> float:
        values = values_of('cart_pole', {**base, **changes}, *BELIEVED)
        loops = PlantLoops(build(values), named_plants(values, CART)[0])
        return loops.noisy(np.array([0.2, 0.3])).cost

    louder = {'joint_states.noise': [noise * np.sqrt(2.0)] * 2}
    half = cost({'joint_states.rate': 50.0})
    assert half == pytest.approx(cost(louder), rel=1e-9)
    assert half > 1.05 * cost({})
