# SPDX-License-Identifier: Apache-2.0
"""Published results on data that no one here made."""

from pathlib import Path

import numpy as np
import pytest
from recorded import data

import kalman_ros as kr
from kalman_ros import scenario
from kalman_ros.core import Gaussian
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.online import OnlineEstimator, Outcome
from kalman_ros.scenario.parameter_files import from_file

CONFIG = Path(__file__).parents[2] / 'config'


def flows():
    return np.loadtxt(data('nile.csv'), delimiter=',', skiprows=1, usecols=1)


def nile(flows, kind='kf', implementation='native'):
    """Run the flows, a year a second, through the scenario of config/nile.yaml."""
    built = scenario.build(from_file(CONFIG / 'nile.yaml', 'estimator'))
    filter = build_filter(kind, built.plan, implementation=implementation)
    sensors = {'reading': built.sensors['reading'].sensor}
    online = OnlineEstimator(filter, sensors, built.initial_belief, np.zeros(0))
    corrections = [
        online.add_reading('reading', year * 1_000_000_000, np.array([flow]))[1]
        for year, flow in enumerate(flows)
    ]
    return corrections, online


@pytest.mark.parametrize('kind', ['kf', 'ekf', 'ukf'])
@pytest.mark.parametrize('implementation', ['native', 'filterpy'])
def test_the_nile(kind, implementation):
    if implementation == 'filterpy':
        pytest.importorskip('filterpy')
    # Durbin and Koopman, Time Series Analysis by State Space Methods (2012), section 2.2
    corrections, _ = nile(flows(), kind, implementation)
    S = np.array([found.innovation_covariance[0, 0] for found in corrections])
    nis = np.array([found.nis for found in corrections])
    likelihoods = -0.5 * (np.log(2.0 * np.pi * S) + nis)
    filtered = [found.posterior.covariance[0, 0] for found in corrections]
    np.testing.assert_allclose(sum(likelihoods), -641.5856, atol=5e-5)
    np.testing.assert_allclose(sum(likelihoods[1:]), -632.5442, atol=5e-5)
    np.testing.assert_allclose([filtered[0], filtered[-1]], [15076.24, 4032.16], atol=5e-3)


def test_years_without_a_reading_only_add_noise():
    # Durbin and Koopman, section 2.7: years 21 to 40 and 61 to 80 taken out
    known = flows()
    known[20:40] = known[60:80] = np.nan
    corrections, online = nile(known)
    P = [None if found is None else found.posterior.covariance[0, 0] for found in corrections]
    assert [p is None for p in P] == np.isnan(known).tolist()
    assert online.counts['reading'] == {Outcome.FUSED: 60, Outcome.NOT_FINITE: 40}
    prior = P[19] + 21 * 1469.1
    np.testing.assert_allclose(P[40], prior * 15099.0 / (prior + 15099.0), rtol=1e-6)
    # the level stays where it was: the first innovation after the gap is from there
    gap = known[40] - corrections[40].innovation[0]
    np.testing.assert_allclose(gap, corrections[19].posterior.mean[0], rtol=1e-12)


def lidar_radar():
    for line in data('lidar_radar_500.txt').read_text().splitlines():
        kind, *numbers = line.split()
        values = np.array(numbers, dtype=float)
        k = 2 if kind == 'L' else 3
        name = 'lidar' if kind == 'L' else 'radar'
        yield name, values[:k], int(values[k]) * 1000, values[k + 1 : k + 5]


def track(name, kind, std):
    """Run the file through the scenario of a model; return the RMSE of x, y, v_x, v_y."""
    built = scenario.build({'model': name})
    first, y, _, _ = next(lidar_radar())
    assert first == 'lidar'
    start = np.concatenate((y, np.zeros(len(std) - 2)))
    sensors = {sensor: source.sensor for sensor, source in built.sensors.items()}
    initial = Gaussian(start, np.diag(np.square(std)))
    online = OnlineEstimator(build_filter(kind, built.plan), sensors, initial, np.zeros(0))
    errors = []
    for sensor, y, time, truth in lidar_radar():
        online.add_reading(sensor, time, y)
        x, y, *velocity = online.belief.mean
        if name == 'turn_rate':
            v, psi, _ = velocity
            velocity = v * np.cos(psi), v * np.sin(psi)
        errors.append(truth - [x, y, *velocity])
    return np.sqrt(np.mean(np.square(errors), axis=0))


@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_lidar_and_radar_with_constant_velocity(kind):
    # bound of udacity/CarND-Extended-Kalman-Filter-Project, acceleration noise 9 m^2/s^4: white
    # over a step of 50 ms that is a density of 9 x 0.05, the model's own
    rmse = track('constant_velocity', kind, [0.15, 0.15, 5.0, 5.0])
    assert np.all(rmse <= [0.11, 0.11, 0.52, 0.52]), rmse
    np.testing.assert_allclose(rmse, [0.0972, 0.0854, 0.4509, 0.4396], rtol=0.12)


def test_lidar_and_radar_with_turn_rate():
    # bound of udacity/CarND-Unscented-Kalman-Filter-Project
    rmse = track('turn_rate', 'ukf', [0.15, 0.15, 5.0, 1.0, np.sqrt(0.5)])
    assert np.all(rmse <= [0.09, 0.10, 0.40, 0.30]), rmse


def test_the_second_half_passes_its_bound_with_what_the_first_half_gave():
    rows = [*lidar_radar()]
    times = 1e-9 * (np.array([time for _, _, time, _ in rows]) - rows[0][2])
    readings = {'lidar': np.full((len(rows), 2), np.nan), 'radar': np.full((len(rows), 3), np.nan)}
    for index, (name, y, _, _) in enumerate(rows):
        readings[name][index] = y
    std = [0.15, 0.15, 5.0, 1.0, np.sqrt(0.5)]
    initial = np.append(rows[0][1], np.zeros(3)), np.diag(np.square(std))
    half = len(rows) // 2
    first = {name: y[:half] for name, y in readings.items()}
    tuned = kr.tune('turn_rate', times[:half], first, initial=initial)
    assert len(tuned.values) == 7  # all noise, of two states and of five numbers
    found = kr.load('turn_rate', tuned.changes)
    x, y, v, psi, _ = kr.filter(found, times=times, readings=readings, initial=initial).mean.T
    estimates = np.column_stack((x, y, v * np.cos(psi), v * np.sin(psi)))
    errors = estimates - [truth for *_, truth in rows]
    rmse = np.sqrt(np.mean(np.square(errors[half:]), axis=0))
    # bound of udacity/CarND-Unscented-Kalman-Filter-Project
    assert np.all(rmse <= [0.09, 0.10, 0.40, 0.30]), rmse


def bag():
    """Yield the readings of the robot's bag: wheel speed and yaw rate, and yaw and its rate.

    The ground is not level, so the part of the wheels' speed that stays in the plane is taken.
    """
    highlevel = pytest.importorskip('rosbags.highlevel')
    pitch = 0.0
    with highlevel.AnyReader([data('diff_drive_61s.bag')]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            time = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            if connection.topic == '/imu/data':
                q = message.orientation
                yaw = np.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
                pitch = np.arcsin(2.0 * (q.w * q.y - q.z * q.x))
                yield 'imu', time, np.array([yaw, message.angular_velocity.z])
            else:
                speed = message.twist.twist
                yield 'odometry', time, np.array([speed.linear.x * np.cos(pitch), speed.angular.z])


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_the_differential_drive_robot_ends_where_it_should(kind):
    # cra-ros-pkg/robot_localization, test_ekf_localization_node_bag3: (1.0206, 3.4292, .7419)
    # within .1383 m; the noise is what the messages say of themselves
    readings = list(bag())
    yaw = next(y[0] for name, _, y in readings if name == 'imu')
    built = scenario.build(
        {
            'model': 'diff_drive',
            'odometry.noise': [0.001**0.5, 0.03**0.5],
            'imu.measures': ['psi', 'omega'],
            'imu.fields': ['orientation.yaw', 'angular_velocity.z'],
            'imu.noise': [0.005, 0.005],
            'initial_estimate': [0.0, 0.0, 0.0, float(yaw), 0.0],
        }
    )
    sensors = {name: source.sensor for name, source in built.sensors.items()}
    filter = build_filter(kind, built.plan)
    online = OnlineEstimator(filter, sensors, built.initial_belief, np.zeros(0))
    for name, time, y in readings:
        assert online.add_reading(name, time, y)[0] is Outcome.FUSED
    assert np.hypot(*(online.belief.mean[:2] - [1.0206, 3.4292])) < 0.1383
