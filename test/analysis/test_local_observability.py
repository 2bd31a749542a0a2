# SPDX-License-Identifier: Apache-2.0
"""What the latest readings tell: by the bound, and with bearings only, where it matters."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from tools.compare.bearings_only import STEP, STEPS, drawn, manoeuvre, moderate

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.analysis.local_observability import ObservabilityMeter, readings_alone
from kalman_ros.analysis.observability import observability
from kalman_ros.core import Gaussian, Model
from kalman_ros.simulation import closed_loop

#: The first belief that the readings are compared with.
PRIOR = np.array([2000.0, 2000.0, 2.0, 2.0])


def told(command, steps=STEPS, seed=0, filter='ukf'):
    """Return what the readings tell after each step of a run, by the estimates of a filter."""
    built = replace(moderate(), initial_belief=drawn(np.random.default_rng(seed)))
    run = closed_loop.run(built, None, steps * STEP, seed, filter=filter, command=command)
    belief = Gaussian(built.initial_belief.mean, np.diag(PRIOR**2))
    meter = ObservabilityMeter(replace(built, initial_belief=belief))
    found = []
    for time, x, u in zip(run.time, run.estimate, run.input):
        stamp = round(time * 1e9)
        meter.reading('bearing', stamp)
        found.append(meter(x))
        meter.input(stamp, u)
    return found, run


@pytest.mark.parametrize('seed', range(4))
def test_an_observer_that_does_not_manoeuvre_never_knows_the_range(seed):
    found, _ = told(lambda time: np.zeros(2), seed=seed)
    assert all(each.verdict.unseen == ('x', 'y', 'v_x', 'v_y') for each in found)
    assert all(np.all(each.std > 100.0 * PRIOR) for each in found)


@pytest.mark.parametrize('seed', range(4))
def test_one_that_manoeuvres_does_until_it_is_long_ago(seed):
    found, run = told(manoeuvre, 60, seed)
    seen = [not each.verdict.unseen for each in found]
    assert not any(seen[:14])
    assert all(seen[20:31])
    assert not any(seen[40:])
    # by then they know it about as well as the filter, which has the first belief and the noise
    filter = np.sqrt(run.covariance[24].diagonal())
    assert np.all(found[24].std > 0.4 * filter)
    assert np.all(found[24].std[:2] < 3.0 * filter[:2])


def test_it_is_the_bound_of_one_who_knows_nothing_else():
    built = scenario.build(
        {
            'model': 'bearing_tracker',
            'model_parameters.acceleration_noise': 0.0,
            'rate': 1.0 / STEP,
            'bearing.rate': 1.0 / STEP,
            'initial_std': (1e4 * PRIOR).tolist(),
        }
    )
    meter, u = ObservabilityMeter(built), np.array([2e-3, -1e-3])
    x, truth, inputs = built.initial_state, [], []
    for step in range(20):
        if step:
            meter.reading('bearing', round(step * STEP * 1e9))
        truth.append(x)
        inputs.append(u * np.sin(step))
        meter.input(round(step * STEP * 1e9), inputs[-1])
        x = built.model.step(x, inputs[-1], STEP)
    bound = posterior_cramer_rao(built, np.array(truth), np.array(inputs))[-1]
    np.testing.assert_allclose(meter(truth[-1]).std, np.sqrt(bound.diagonal()), rtol=1e-3)


def test_a_state_that_no_sensor_sees_is_not_seen_and_the_others_are():
    built = scenario.build({'model': 'turn_rate', 'sensors': ['lidar']})
    meter = ObservabilityMeter(built)
    x = built.initial_state
    for step in range(20):
        meter.reading('lidar', step * 100_000_000)
        x = built.model.step(x, np.zeros(0), 0.1) if step else x
    assert meter(x).verdict.unseen == ()
    still = x * [1.0, 1.0, 0.0, 1.0, 1.0]  # where it does not move, it has no heading
    assert meter(still).verdict.unseen == ('psi', 'omega')
    assert np.isinf(meter(still).std[3])
    assert meter.report(still)['observability'] == 'the sensors observe x, y, v; not psi, omega'


def test_where_the_past_runs_away_it_ends():
    """Back in time friction makes every error grow, so that old readings tell little."""
    values = {'model': 'submersible', 'model_parameters.angular_drag': 4000.0}
    meter = ObservabilityMeter(scenario.build(values))
    for step in range(100):
        meter.reading('imu', step * 10_000_000)
        meter.reading('pressure', step * 10_000_000)
    found = meter(np.zeros(6))
    assert 'x' in found.verdict.unseen
    assert 'pitch' in found.verdict.seen
    assert not np.isnan(found.std).any()


def test_it_restarts_when_the_clock_goes_back():
    built = replace(moderate(), initial_belief=Gaussian(np.zeros(4), np.diag(PRIOR**2)))
    meter = ObservabilityMeter(built)
    x = moderate().initial_state
    for step in range(20):
        meter.reading('bearing', round((100 + step) * STEP * 1e9))
        meter.input(round((100 + step) * STEP * 1e9), np.array([0.0, 0.05 * (step > 8)]))
    assert not meter(x).verdict.unseen
    meter.reading('bearing', 0)
    assert len(meter(x).verdict.unseen) == 4


def test_with_biases_as_states_it_judges_the_states_of_the_model():
    values = {'model': 'turn_rate', 'lidar.bias_std': [0.2, 0.3]}
    built = scenario.build(values)
    whole = built.believed
    assert whole.model.state.size == built.model.state.size + 2
    alone, both = ObservabilityMeter(built), ObservabilityMeter(built, whole.model, whole.sensors)
    x = built.initial_state
    for step in range(20):
        for meter in (alone, both):
            meter.reading('lidar', step * 100_000_000)
            meter.reading('radar', step * 100_000_000)
    found = both(np.append(x, [0.1, -0.1]))
    assert found.verdict == alone(x).verdict
    np.testing.assert_allclose(found.std, alone(x).std, rtol=1e-9)
    assert both.report(np.append(x, [0.1, -0.1])) == alone.report(x)


def test_a_linear_scenario_has_its_verdict_at_once():
    built = scenario.build({'sensors': ['velocity']})
    meter = ObservabilityMeter(built)
    meter.input(0, np.zeros(2))
    meter.reading('velocity', 0)
    assert meter.report(np.zeros(4)) == {'observability': str(observability(built))}


@pytest.fixture
def robot():
    """A robot in space and its meter after 0.6 s."""
    built = scenario.build({'model': 'robot_3d', 'sensors': ['odometry', 'imu']})
    meter = ObservabilityMeter(built)
    for step in range(60):
        meter.reading('imu', step * 10_000_000)
        if step % 5 == 0:
            meter.reading('odometry', step * 10_000_000)
    return built, meter


@pytest.mark.parametrize('slow', [False, True])
def test_a_report_takes_few_steps_whatever_the_rates_and_gaps(robot, monkeypatch, slow):
    built, meter = robot
    taken, step = [], type(built.model).linearized_step
    monkeypatch.setattr(
        type(built.model),
        'linearized_step',
        lambda model, x, u, dt: taken.append(dt) or step(model, x, u, dt),
    )
    if slow:  # pieces of seconds, in which the model takes steps of 10 ms
        built = scenario.build(
            {'model': 'robot_3d', 'sensors': ['odometry'], 'odometry.rate': 0.5}
        )
        meter = ObservabilityMeter(built)
        for second in range(0, 60, 2):
            meter.reading('odometry', second * 1_000_000_000)
    else:
        meter.reading('imu', 5_000_000_000)  # and now the first piece back is 4.4 s long
    assert not np.isnan(meter(built.initial_state).std).any()
    assert 0 < len(taken) <= 100
    assert max(taken) < 0.0


class Stiff(Model):
    """A body of four states on which friction acts."""

    def __init__(self, like):
        self.state, self.input, self.max_step = like.state, like.input, like.max_step

    def derivative(self, x, u):
        return -100.0 * np.sinh(x)

    def noise_density(self, x):
        return np.eye(4)


@pytest.mark.parametrize('x', [1.0, 1e6, 1e160, np.inf, np.nan])
@pytest.mark.parametrize('stiff', [True, False])
def test_a_path_that_leads_beyond_all_numbers_ends_there(x, stiff):
    built = scenario.build({'model': 'cart_pole'})
    meter = ObservabilityMeter(built, Stiff(built.model) if stiff else None)
    for step in range(25):
        for name in built.enabled:
            meter.reading(name, 1_000_000_000 + step * 10_000_000)
    with np.errstate(all='ignore'):
        report = meter.report(np.full(4, x))
    assert report['observability'].startswith('the sensors observe')
    if np.isfinite(x):
        assert {'x', 'theta'} <= {*meter(np.full(4, x)).verdict.seen}


def test_an_early_reading_tells_of_the_state_by_the_whole_way_back():
    """The steps of a turn do not commute: the first reading, by differences of the whole way."""
    built = scenario.build({'model': 'turn_rate', 'sensors': ['lidar'], 'lidar.rate': 2.0})
    meter, sensor = ObservabilityMeter(built), built.sensors['lidar'].sensor
    way, x = [], built.initial_state + np.array([0.0, 0.0, 0.0, 0.3, 0.7])
    for step in range(8):
        way.append(x)
        meter.reading('lidar', step * 500_000_000)
        x = built.model.step(x, np.zeros(0), 0.5)
    here, n = way[-1], 5

    def back(x, count):
        for _ in range(count):
            x = built.model.step(x, np.zeros(0), -0.5)
        return sensor.measure(x)

    R, M = np.linalg.inv(sensor.covariance), np.zeros((n, n))
    for count in (0, 1, 2, 3, 4, 5, 6, 6):  # the first two are in one piece
        H = np.column_stack(
            [(back(here + d, count) - back(here - d, count)) / 2e-5 for d in 1e-5 * np.eye(n)]
        )
        M += H.T @ R @ H
    expected = readings_alone(M, built.initial_belief.std)
    np.testing.assert_allclose(meter(here).std, expected, rtol=0.003)


def test_a_state_that_is_known_exactly_or_not_at_all_is_judged_in_its_unit():
    gramian = np.diag([4.0, 4.0, 4.0, 0.0])
    std = readings_alone(gramian, np.array([1.0, 3e-5, inf, inf]))
    np.testing.assert_allclose(std, [0.5, 0.5, 0.5, inf])
