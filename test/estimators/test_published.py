# SPDX-License-Identifier: Apache-2.0
"""Published results on data that no one here made."""

import os
from pathlib import Path

import numpy as np
import pytest

from kalman_ros.core import Gaussian, LinearSystem, Model, Sensor, Space, TimedSensor, variances
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filter import Plan
from kalman_ros.estimators.online import OnlineEstimator
from kalman_ros.sensors.states import States

DATA = Path(os.environ.get('KALMAN_ROS_DATA', Path(__file__).parents[3] / 'shared' / 'data'))


def data(name):
    path = DATA / name
    if not path.exists():
        pytest.skip(f'{path.name} is not in {DATA}; set KALMAN_ROS_DATA')
    return path


@pytest.mark.parametrize('kind', ['kf', 'ekf', 'ukf'])
@pytest.mark.parametrize('implementation', ['native', 'filterpy'])
def test_the_nile(kind, implementation):
    if implementation == 'filterpy':
        pytest.importorskip('filterpy')
    # Durbin and Koopman, Time Series Analysis by State Space Methods (2012), section 2.2
    flows = np.loadtxt(data('nile.csv'), delimiter=',', skiprows=1, usecols=1)
    level = Space(('level',), ('',))
    system = LinearSystem([[0.0]], [[0.0]], [[1469.1]], level, Space(('u',), ('',)))
    sensor = States(level, [np.sqrt(15099.0)], ('level',))
    plan = Plan(system, {'flow': TimedSensor(sensor, 1.0)}, 1.0)
    filter = build_filter(kind, plan, implementation=implementation)
    belief, likelihoods, filtered = Gaussian(np.zeros(1), np.array([[1e7]])), [], []
    for year, flow in enumerate(flows):
        if year:
            belief = filter.predict(belief, np.zeros(1), 1.0)
        found = filter.correct(belief, np.array([flow]), sensor)
        S = found.innovation_covariance[0, 0]
        likelihoods.append(-0.5 * (np.log(2.0 * np.pi * S) + found.nis))
        belief = found.posterior
        filtered.append(belief.covariance[0, 0])
    np.testing.assert_allclose(sum(likelihoods), -641.5856, atol=5e-5)
    np.testing.assert_allclose(sum(likelihoods[1:]), -632.5442, atol=5e-5)
    np.testing.assert_allclose([filtered[0], filtered[-1]], [15076.24, 4032.16], atol=5e-3)


class Radar(Sensor):
    """Range, bearing and range rate of a point that moves in the plane."""

    def __init__(self):
        self.output = Space(('rho', 'phi', 'rho_dot'), ('m', 'rad', 'm/s'), angles=('phi',))
        self.covariance = variances('noise', [0.3, 0.03, 0.3], 3)

    def measure(self, x):
        px, py, vx, vy = np.moveaxis(x, -1, 0)
        rho = np.maximum(np.hypot(px, py), 1e-6)
        return np.stack((rho, np.arctan2(py, px), (px * vx + py * vy) / rho), axis=-1)


class TurnRate(Model):
    """Constant speed and turn rate (CTRV), with noise on both accelerations."""

    state = Space(
        ('px', 'py', 'v', 'psi', 'omega'), ('m', 'm', 'm/s', 'rad', 'rad/s'), angles=('psi',)
    )
    input = Space(('none',), ('',))
    max_step = 0.05

    def derivative(self, x, u):
        _, _, v, psi, omega = np.moveaxis(x, -1, 0)
        still = np.zeros_like(v)
        return np.stack((v * np.cos(psi), v * np.sin(psi), still, omega, still), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.0, 0.05, 0.0, 0.02])


class TurnRateRadar(Radar):
    def measure(self, x):
        px, py, v, psi, _ = np.moveaxis(x, -1, 0)
        return super().measure(np.stack((px, py, v * np.cos(psi), v * np.sin(psi)), axis=-1))


def lidar_radar():
    for line in data('lidar_radar_500.txt').read_text().splitlines():
        kind, *numbers = line.split()
        values = np.array(numbers, dtype=float)
        k = 2 if kind == 'L' else 3
        yield kind, values[:k], int(values[k]) * 1000, values[k + 1 : k + 5]


def track(filter, sensors, initial, to_plane):
    """Run the file through the online estimator and return errors of px, py, vx, vy."""
    online = OnlineEstimator(filter, sensors, initial, np.zeros(1))
    errors = []
    for kind, y, time, truth in lidar_radar():
        online.add_reading(kind, time, y)
        errors.append(truth - to_plane(online.belief.mean))
    return np.sqrt(np.mean(np.square(errors), axis=0))


def start(first_two_states):
    kind, y, _, _ = next(lidar_radar())
    assert kind == 'L'
    x = np.zeros(first_two_states)
    x[:2] = y
    return x


@pytest.mark.parametrize('kind', ['ekf', 'ukf'])
def test_lidar_and_radar_with_constant_velocity(kind):
    # bound of udacity/CarND-Extended-Kalman-Filter-Project, acceleration noise 9 m^2/s^4: white
    # over a step of 50 ms that is a density of 9 x 0.05
    space = Space(('px', 'py', 'vx', 'vy'), ('m', 'm', 'm/s', 'm/s'))
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    W = np.diag([0.0, 0.0, 0.45, 0.45])
    system = LinearSystem(A, np.zeros((4, 1)), W, space, Space(('none',), ('',)))
    sensors = {'L': States(space, [0.15, 0.15], ('px', 'py')), 'R': Radar()}
    plan = Plan(system, {n: TimedSensor(s, 10.0) for n, s in sensors.items()}, 20.0)
    initial = Gaussian(start(4), np.diag([0.15**2, 0.15**2, 25.0, 25.0]))
    rmse = track(build_filter(kind, plan), sensors, initial, lambda x: x)
    assert np.all(rmse <= [0.11, 0.11, 0.52, 0.52]), rmse
    np.testing.assert_allclose(rmse, [0.0972, 0.0854, 0.4509, 0.4396], rtol=0.12)


def test_lidar_and_radar_with_turn_rate():
    # bound of udacity/CarND-Unscented-Kalman-Filter-Project
    sensors = {'L': States(TurnRate.state, [0.15, 0.15], ('px', 'py')), 'R': TurnRateRadar()}
    plan = Plan(TurnRate(), {n: TimedSensor(s, 10.0) for n, s in sensors.items()}, 20.0)
    initial = Gaussian(start(5), np.diag([0.15**2, 0.15**2, 25.0, 1.0, 0.5]))
    rmse = track(
        build_filter('ukf', plan),
        sensors,
        initial,
        lambda x: np.array([x[0], x[1], x[2] * np.cos(x[3]), x[2] * np.sin(x[3])]),
    )
    assert np.all(rmse <= [0.09, 0.10, 0.40, 0.30]), rmse
