# SPDX-License-Identifier: Apache-2.0
"""What is said of sensors: nothing of those that are as believed, and the fault of others."""

from collections import defaultdict

import numpy as np
import pytest
from thorough import mostly_thorough, thorough

pytest.importorskip('rclpy')

from kalman_ros.codecs.layout import Sample
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.sensor_watch import SensorWatch
from kalman_ros.scenario import shipped
from kalman_ros.scenario.regulator import feedback
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.faults.plant_faults import PlantFaults

pytestmark = pytest.mark.slow

FRAME = 0.03


def ran(name, seconds, seed=1, believed=None, **faults):
    """Return the scenario of the estimator of a shipped one, and a run with faults of a sensor."""
    adjustments = Adjustments(shipped.file(name), {})
    plant = adjustments.scenario('plant')
    if believed:
        adjustments.change('estimator', believed)
    scenario = adjustments.scenario('estimator')
    sensor = next(iter(scenario.enabled))
    gain = feedback(adjustments.scenario('controller')).gain if adjustments.driven else None
    given = {f'{sensor}.{fault}': value for fault, value in faults.items()}
    broken = PlantFaults.from_values(plant.timed, plant.model.input.size, given)
    run = closed_loop.run(plant, gain, seconds, seed, believed=scenario, faults=broken)
    return scenario, run


def frames(scenario, run, delay=0.0):
    """Yield the samples of a run as they arrive, frame by frame."""
    dt = run.time[1] - run.time[0]
    step = max(1, round(FRAME / dt))
    for start in range(0, len(run.time), step):
        samples = defaultdict(list)
        part = slice(start, start + step)
        samples['ground_truth'] = [
            Sample(round(t * 1e9), x, None) for t, x in zip(run.time[part], run.truth[part])
        ]
        for name, readings in run.readings.items():
            arrived = readings.time + delay
            here = (arrived > run.time[start] - 0.5 * dt) & (
                arrived < run.time[start] + (step - 0.5) * dt
            )
            samples[scenario.sensors[name].signal.topic] = [
                Sample(round(t * 1e9), y, None)
                for t, y in zip(readings.time[here], readings.values[here])
            ]
        yield samples


def said(scenario, run, delay=0.0):
    """Return what is said of the first sensor at the end, and how often of any before."""
    watch, count = SensorWatch(), 0
    for k, samples in enumerate(frames(scenario, run, delay)):
        watch.add(samples, scenario)
        count += bool(k % 16 == 0 and watch.troubles(scenario))
    return watch.troubles(scenario).get(next(iter(scenario.enabled)), {}), count


@pytest.mark.parametrize(
    'name',
    mostly_thorough(
        [
            'cart_pole',
            'mass_spring_damper',
            'gnss_imu',
            'two_bearings',
            'turn_rate',
            'submersible',
        ],
        'cart_pole',
        'gnss_imu',
    ),
)
@pytest.mark.parametrize('seed', mostly_thorough([3, 5], 3))
def test_nothing_is_said_of_sensors_as_believed(name, seed):
    assert said(*ran(name, 15.0, seed)) == ({}, 0)


@pytest.mark.parametrize(
    ('faults', 'kind', 'number'),
    [
        ({'dropout': 1.0}, 'silent', ('seconds', 6.0, 0.1)),
        thorough({'dropout': 0.6}, 'lost', ('share', 0.6, 0.1)),
        thorough({'freeze': True}, 'frozen', None),
        ({'outliers': 0.05}, 'outliers', ('share', 0.05, 0.03)),
    ],
)
def test_a_fault_is_named(faults, kind, number):
    found, _ = said(*ran('cart_pole', 6.0, **faults))
    assert found['kind'] == kind
    if number:
        key, value, tolerance = number
        assert found[key] == pytest.approx(value, abs=tolerance)


@pytest.mark.parametrize('bias', [thorough([0.05, 0.0]), thorough([0.0, -0.05]), [0.03, -0.05]])
def test_every_coordinate_with_a_bias_is_named(bias):
    found, _ = said(*ran('cart_pole', 6.0, bias=bias))
    assert found['kind'] == 'bias'
    known = {'x': ('m', bias[0]), 'theta': ('rad', bias[1])}
    assert [off['name'] for off in found['off']] == [name for name in known if known[name][1]]
    for off in found['off']:
        unit, size = known[off['name']]
        assert off['unit'] == unit
        assert off['size'] == pytest.approx(size, abs=0.003)


@pytest.mark.parametrize('factor', [0.25, 4.0])
def test_noise_that_is_not_as_believed_is_named(factor):
    believed = {'joint_states.noise': [factor * 0.005, 0.005]}
    found, _ = said(*ran('cart_pole', 6.0, believed=believed))
    (off,) = found['off']
    assert (found['kind'], off['name'], off['unit']) == ('noise', 'x', 'm')
    assert off['factor'] == pytest.approx(1.0 / factor, rel=0.2)


def test_late_readings_are_named_and_compared_with_the_truth_of_their_stamps():
    found, _ = said(*ran('cart_pole', 6.0), delay=0.3)
    assert found['kind'] == 'late'
    assert found['seconds'] == pytest.approx(0.3, abs=2.0 * FRAME)


def test_readings_from_before_a_restart_do_not_count():
    scenario, biased = ran('cart_pole', 3.0, bias=[0.05, 0.0])
    watch = SensorWatch()
    *first, last = frames(scenario, biased)
    for samples in first:
        watch.add(samples, scenario)
    assert watch.troubles(scenario)['joint_states']['kind'] == 'bias'
    watch.restart(skip=1)
    assert watch.troubles(scenario) == {}
    watch.add(last, scenario)  # it was on its way
    _, clean = ran('cart_pole', 6.0)
    for samples in frames(scenario, clean):
        watch.add(samples, scenario)
    assert watch.troubles(scenario) == {}


def test_a_sensor_that_the_estimator_does_not_use_is_not_watched():
    scenario, run = ran('cart_pole', 2.0, bias=[0.05, 0.0])
    adjustments = Adjustments(shipped.file('cart_pole'), {})
    adjustments.change('estimator', {'joint_states.enabled': False}, tried=True)
    without, watch = adjustments.scenario('estimator'), SensorWatch()
    for samples in frames(scenario, run):
        watch.add(samples, without)
    assert watch.troubles(without) == {}


def test_readings_that_are_no_numbers_are_passed_over():
    scenario, run = ran('cart_pole', 3.0)
    run.readings['joint_states'].values[50:60] = np.nan
    found, _ = said(scenario, run)
    assert found == {}
