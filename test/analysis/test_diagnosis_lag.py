# SPDX-License-Identifier: Apache-2.0
"""A sensor that follows what it measures with a lag, beside one that reports it late."""

from dataclasses import replace

import numpy as np
import pytest

from kalman_ros.analysis.diagnosis import lagging, sensor_lag
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.core import Space
from kalman_ros.programs.doctor.recordings import recorded

LAG = 0.3


@pytest.fixture(scope='module')
def clean():
    return recorded('diff_drive', seconds=16.0, seed=4)


def of_gyro(evidence):
    """Return the times of the readings of the gyro, and the predictions of a filter."""
    passage, sensor = Examination(evidence).passage, evidence.scenario.sensors['imu'].sensor
    events = [passage.events[k] for k in passage.of('imu')]
    return np.array([e.time for e in events]), sensor.measure(np.array([e.x for e in events]))


@pytest.fixture(scope='module')
def lagging_behind(clean):
    times, values = of_gyro(clean)
    record = clean.sensors['imu']
    effect = np.interp(record.stamp, times, lagging.behind(times, values, LAG)[:, 0])
    return clean.with_values('imu', record.value + effect[:, None])


def test_a_lag_is_that_of_a_fine_integration():
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.02, 0.3, 40))
    values = np.cumsum(rng.normal(size=(40, 2)), axis=0)
    found = lagging.behind(times, values, LAG)
    fine = np.linspace(times[0], times[-1], 200_001)
    dt = fine[1] - fine[0]
    for i in range(2):
        m = np.interp(fine, times, values[:, i])
        lagged = np.empty_like(m)
        lagged[0] = m[0]
        left = np.exp(-dt / LAG)
        for k in range(1, len(m)):
            lagged[k] = left * lagged[k - 1] + (1.0 - left) * 0.5 * (m[k] + m[k - 1])
        expected = np.interp(times, fine, lagged) - values[:, i]
        np.testing.assert_allclose(found[:, i], expected, atol=1e-4)


def test_a_ramp_is_behind_by_the_lag_in_the_end():
    times = np.arange(0.0, 20.0, 0.1)
    found = lagging.behind(times, 3.0 * times[:, np.newaxis], LAG)
    assert found[0, 0] == 0.0 and found[-1, 0] == pytest.approx(-3.0 * LAG)


def test_trial_lags_are_between_the_interval_and_a_share_of_the_recording():
    found = lagging.lags(np.arange(0.0, 100.0, 0.1))
    assert found[0] == pytest.approx(0.1) and found[-1] == pytest.approx(0.05 * 99.9)
    assert not len(lagging.lags(np.arange(2.0)))
    assert not len(lagging.lags(np.arange(3.0)))  # the longest is shorter than an interval
    long = lagging.lags(np.arange(0.0, 1e5, 1.0))
    assert long[-1] == pytest.approx(20.0)


def test_angles_do_not_jump_and_rotations_have_no_lag():
    times = np.arange(5.0) * 0.1
    around = np.array([3.0, 3.1, -3.1, -3.0, -2.9])[:, np.newaxis]
    space = Space('psi', 'rad', angles='psi')
    assert np.abs(np.diff(lagging.continuous(around, space)[:, 0])).max() < 0.2
    turned = Space('a b c', rotations=[('a', 'b', 'c')])
    labels, block = lagging.columns(times, np.zeros((5, 3)), turned)
    assert not labels and block.shape == (5, 3, 0)


def test_what_lags_is_found_with_its_time(clean, lagging_behind):
    best = diagnose(lagging_behind).findings[0]
    assert (best.kind, best.subject) == ('lag', 'imu')
    (time,) = (float(word) for word in best.sentence.split('some ')[1].split(' s')[:1])
    assert time == pytest.approx(LAG, rel=0.3)
    assert not any(finding.kind == 'lag' for finding in diagnose(clean).findings)


def test_chance_is_no_lag(clean):
    assert not [*sensor_lag.find(Examination(clean))]


def test_what_is_late_is_late():
    moving = recorded('robot_2d', seconds=16.0, seed=4)
    record = moving.sensors['position']
    late = replace(record, stamp=record.stamp + LAG, received=record.received + LAG)
    best = diagnose(moving.with_sensor('position', late)).findings[0]
    assert (best.kind, best.subject) == ('stamps late', 'position')
    assert ('lag', 'position') in best.same_as


def test_a_lag_is_taken_out_again(lagging_behind, clean):
    (finding,) = sensor_lag.find(Examination(lagging_behind))
    after = Examination(finding.mended())
    nearer = finding.again(after)
    before, found, more = (
        np.std(each.sensors['imu'].value - clean.sensors['imu'].value)
        for each in (lagging_behind, finding.mended(), nearer.mended())
    )
    assert more < found < 0.7 * before
