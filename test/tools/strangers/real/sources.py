# SPDX-License-Identifier: Apache-2.0
"""Recordings that others published, as readings: a channel for each sensor.

They have no noise of their own in a channel, since no one knows it. Where a source has no times of
reception, readings are received when they are stamped.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from ..simulation import Array, Channel, Readings

_BESIDE = Path(__file__).parents[5] / 'shared' / 'data'


class AbsentError(ValueError):
    """Data, or what reads them, are absent."""


def data(name: str) -> Path:
    """Return the path of a file of the folder in which the tests look for data.

    Raises
    ------
    AbsentError
        If it is not there.
    """
    folder = Path(os.environ.get('KALMAN_ROS_DATA', _BESIDE))
    if not (folder / name).exists():
        raise AbsentError(f'{name} is not in {folder}; set KALMAN_ROS_DATA')
    return folder / name


def _reader(module: str) -> ModuleType:
    try:
        return import_module(module)
    except ImportError as error:
        raise AbsentError(f'{error}; python3 -m pip install {module.split(".")[0]}') from error


def _channel(topic: str, form: str, time: Array, value: Array, *, sensor: bool = True) -> Channel:
    value = np.array(value, dtype=float).reshape(len(time), -1)
    still = np.zeros_like(value)
    return Channel(topic, form, time, value, still, time.copy(), time.copy(), sensor)


def diff_drive(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute of a Jackal on hilly ground: wheels, and an IMU that knows its attitude.

    The messages of the IMU become two, of its rates and of its attitude.
    """
    rows: dict[str, list[list[float]]] = {'/imu/data': [], '/jackal_velocity_controller/odom': []}
    with _reader('rosbags.highlevel').AnyReader([data('diff_drive_61s.bag')]) as bag:
        for connection, received, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            times = [1e-9 * received, stamp.sec + 1e-9 * stamp.nanosec]
            if connection.topic == '/imu/data':
                vectors = message.angular_velocity, message.linear_acceleration
                q = message.orientation
                y = [getattr(v, axis) for v in vectors for axis in 'xyz'] + [q.x, q.y, q.z, q.w]
            else:
                y = [message.twist.twist.linear.x, message.twist.twist.angular.z]
            rows[connection.topic].append(times + y)
    imu, odometry = (np.array(each) for each in rows.values())
    begin = min(imu[0, 1], odometry[0, 1])
    readings = {
        'wheels': _channel('odom', 'odometry', odometry[:, 1] - begin, odometry[:, 2:]),
        'gyro': _channel('imu', 'imu', imu[:, 1] - begin, imu[:, 2:8]),
        'heading': _channel('attitude', 'attitude', imu[:, 1] - begin, imu[:, 8:]),
    }
    for name, table in (('wheels', odometry), ('gyro', imu), ('heading', imu)):
        readings[name].received[:] = table[:, 0] - begin
    return readings


def car_60s(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute of a car on a road: fixes, the speed of its wheels, and an IMU."""
    folder = data('car_60s')
    begin = np.load(folder / 'frame_times.npy')[0]

    def read(name: str, every: int = 1) -> tuple[Array, Array]:
        time, value = (np.load(folder / f'{name}_{part}.npy') for part in ('t', 'value'))
        return (time - begin)[::every], value[::every]

    fix_time, fixes = read('live_gnss_ublox')
    wheel_time, speed = read('speed', 4)
    time, rate = read('gyro')
    # forward, left, up of forward, right, down
    turned = np.hstack((rate, read('accelerometer')[1])) * [1, -1, -1, 1, -1, -1]
    return {
        'gnss': _channel('fix', 'place', fix_time, fixes[:, [0, 1, 4]]),
        'wheels': _channel('odom', 'odometry', wheel_time, speed * [1.0, 0.0]),
        'input': _channel('imu', 'imu', time, turned, sensor=False),
    }


def uwb_robot(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return half a minute of a robot on two wheels between four radio anchors.

    Its readme has the wheels in the other order and half as far apart: `test/recorded_bags.py`.
    """
    lines = [line.split() for line in (data('uwb_robot') / 'Indoor_UWB_Input.txt').open()]
    time, right, left = np.array([line[1:4] for line in lines if line[0] == 'odom2diff'], float).T
    drive = np.stack((0.5 * (right + left), (left - right) / (2 * 0.0785)), axis=1)
    readings = {'odometry': _channel('odom', 'odometry', time, drive)}
    for anchor in ('105', '107', '109', '108'):
        rows = [line[1:3] for line in lines if line[0] == 'range2' and line[6] == anchor]
        at, distance = np.array(rows, float).T
        readings[f'anchor_{anchor}'] = _channel(f'range_{anchor}', 'range', at, distance)
    return readings


def lidar_radar(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return 25 s of a vehicle that a lidar and a radar see in turn."""
    lines = [line.split() for line in data('lidar_radar_500.txt').open()]
    begin = int(lines[0][3])

    def read(sensor: str, form: str, size: int) -> Channel:
        rows = np.array([line[1 : size + 2] for line in lines if line[0] == sensor[0].upper()])
        time = 1e-6 * (rows[:, size].astype(int) - begin)
        return _channel(sensor, form, time, rows[:, :size].astype(float))

    return {'lidar': read('lidar', 'point', 2), 'radar': read('radar', 'echo', 3)}


def driven_pendulum(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return 4 s of a pendulum on a motor, which measures angle, speed and torque at 300 Hz."""
    table = np.loadtxt(data('pendulum') / 'data_measured.csv', delimiter=',', skiprows=1)
    forms = {'position': 'angle', 'velocity': 'turning', 'torque': 'drive_torque'}
    return {
        name: _channel(name, form, table[:, 0].copy(), table[:, k])
        for k, (name, form) in enumerate(forms.items(), 1)
    }


def imu_optical(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return three minutes of an IMU with a magnetometer that is turned by hand.

    Five readings are averaged; those of the magnetometer are five times rarer again.
    """
    file = data('imu_optical') / '02_undisturbed_slow_rotation_B.hdf5'
    with _reader('h5py').File(file) as table:
        read = [np.array(table[f'imu_{name}']) for name in ('gyr', 'acc', 'mag')]
    count = len(read[0]) // 5
    rate, force, field = (each[: 5 * count].reshape(count, 5, 3).mean(axis=1) for each in read)
    time = 5 / 285.714 * np.arange(1.0, count + 1.0)
    # an input holds from its stamp on, and a mean is that of the time before
    before = time - time[0]
    return {
        'magnetometer': _channel('magnetometer', 'field', time[::5], 1e-6 * field[::5]),
        'input': _channel('imu', 'imu', before, np.hstack((rate, force)), sensor=False),
    }
