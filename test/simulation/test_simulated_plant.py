# SPDX-License-Identifier: Apache-2.0
from fractions import Fraction

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import is_due, period, ratio
from kalman_ros.simulation.faults import options_of_sensors
from kalman_ros.simulation.faults.body import BodyOptions
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.noise import NoiseSource
from kalman_ros.simulation.simulated_plant import SimulatedPlant


def plant(seed=1, **values):
    built = scenario.build(values)
    timed = {name: source.timed for name, source in built.sensors.items()}
    return SimulatedPlant(built.model, timed, built.rate, built.initial_state, seed)


def run(plant, steps=60):
    states, readings = [], {name: [] for name in plant.sensors}
    for _ in range(steps):
        for name, y in plant.readings().items():
            readings[name].append(y)
        states.append(plant.state)
        plant.step(np.zeros(2))
    return np.array(states), {name: np.array(ys) for name, ys in readings.items()}


@pytest.mark.parametrize(
    ('rate', 'loop', 'steps'), [(20, 100, 100), (30, 100, 100), (7, 100, 700)]
)
def test_a_sensor_reads_at_its_rate(rate, loop, steps):
    share = ratio(rate, loop)
    due = [step for step in range(1, steps + 1) if is_due(step, share)]
    assert len(due) == steps * rate // loop
    gaps = np.diff(due)
    assert gaps.max() - gaps.min() <= 1


def test_all_rates_repeat_after_their_period():
    shares = [Fraction(1, 5), Fraction(3, 10), Fraction(1)]
    p = period(shares)
    assert p == 10
    for share in shares:
        first = [is_due(step, share) for step in range(1, p + 1)]
        assert first == [is_due(step, share) for step in range(p + 1, 2 * p + 1)]


@pytest.mark.parametrize('rate', [200.0, 0.004])
def test_a_sensor_faster_than_the_loop_or_hardly_ever_is_refused(rate):
    with pytest.raises(ValueError, match=f'rate: expected 0.01 to 100 Hz, got {rate:g}'):
        ratio(rate, 100.0)
    assert ratio(0.01, 100.0) == Fraction(1, 10_000)


def test_a_seed_reproduces_and_another_does_not():
    states, readings = run(plant(seed=1))
    again, same = run(plant(seed=1))
    np.testing.assert_array_equal(states, again)
    np.testing.assert_array_equal(readings['velocity'], same['velocity'])
    assert not np.array_equal(run(plant(seed=2))[0], states)


def test_changing_one_sensor_leaves_all_other_noise_as_it_was():
    states, readings = run(plant())
    changes = (
        {'position.rate': 50.0},
        {'position.noise': [1.0, 1.0]},
        {'position.enabled': False},
        {'sensors': ['velocity']},
    )
    for change in changes:
        changed, others = run(plant(**change))
        np.testing.assert_array_equal(changed, states)
        np.testing.assert_array_equal(others['velocity'], readings['velocity'])


def test_readings_of_a_step_are_drawn_once():
    system = plant()
    np.testing.assert_array_equal(system.readings()['position'], system.readings()['position'])


def test_noise_has_its_covariance():
    P = np.array([[2.0, -0.8], [-0.8, 0.5]])
    source = NoiseSource(0, 'a')
    draws = np.array([source.draw(P) for _ in range(20_000)])
    np.testing.assert_allclose(draws.T @ draws / len(draws), P, atol=0.06)
    assert abs(draws.mean()) < 0.03


def test_noise_may_be_zero_in_some_directions():
    draws = np.array([NoiseSource(seed, 'a').draw(np.diag([0.0, 1.0])) for seed in range(50)])
    np.testing.assert_array_equal(draws[:, 0], 0.0)
    assert draws[:, 1].std() > 0.5


def test_a_disturbance_and_a_fault_of_the_body_push_together():
    built = scenario.build({})
    timed = {name: source.timed for name, source in built.sensors.items()}
    states = []
    for push, fault in ((0.0, 0.0), (3.0, 0.0), (0.0, 2.0), (3.0, 2.0)):
        plant = SimulatedPlant(built.model, timed, built.rate, built.initial_state, 1)
        settings = {option.name: option.default for option in options_of_sensors(timed)}
        body = BodyOptions(disturbance_constant=[fault, 0.0], actuator_delay=0.0)
        plant.adopt(PlantFaults(timed, 2, body, settings))
        plant.step(np.zeros(2), np.array([push, 0.0]))
        states.append(plant.state)
    still, pushed, faulty, both = states
    assert abs(pushed - still).max() > 1e-3 < abs(faulty - still).max()
    np.testing.assert_allclose(both - still, pushed - still + faulty - still, atol=1e-12)
