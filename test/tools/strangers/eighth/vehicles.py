# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a wheelchair, an electric bicycle, an omni robot, a hexacopter and a cyclist.

Inputs are programs of time, or the readings of the IMU; the cyclist has none.
"""

from __future__ import annotations

import math

import numpy as np

from ..fifth.rotations import Quaternion, exponential, product, rotated
from ..second.vehicles import GRAVITY, Physics
from ..simulation import (
    Array,
    Readings,
    Track,
    Vector,
    column,
    commanded,
    integrate,
    sampled,
    square,
)

#: Angles at which the wheels of the omni robot are, in rad from the front.
_WHEELS = tuple(math.radians(angle) for angle in (60, 180, 300))
#: The path of the hexacopter: of each coordinate the mean, and amplitude and rate of two sines.
_PATH = (
    (0.0, (9.0, 0.31), (1.2, 1.3)),
    (0.0, (7.0, 0.43), (1.0, 1.1)),
    (25.0, (3.0, 0.25), (0.5, 0.9)),
)


def air_pressure(height: Array) -> Array:
    """Return the pressure in Pa at a height above the sea in m, in the standard atmosphere."""
    share: Array = 1.0 - 0.0065 * height / 288.15
    return np.asarray(101325.0 * share**5.255876)


def wheelchair(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a powered wheelchair indoors, which a laser scanner locates in a map.

    From ``halt`` on it is told to stand still for 25 s.
    """
    halt = physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn = x
        return v * math.cos(psi), v * math.sin(psi), turn, (u[0] - v) / 0.4, (u[1] - turn) / 0.4

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 25.0:
            return 0.0, 0.0
        return 0.7 + 0.3 * square(t, 17.0), 0.45 * square(t, 9.0) + 0.25 * math.sin(0.9 * t)

    start = rng.normal([6.0, 5.0, 1.0, 0.6, 0.0], [0.1, 0.1, 0.05, 0.1, 0.05])
    density = [0, 0, 0, 0.01, 0.01]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, drive, 0.1)
    return {
        'odom': sampled(
            truth, 'odom', 'odometry', 25.0, lambda x: [x[3], x[4]], [0.03, 0.04], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'amcl': sampled(
            truth, 'amcl_pose', 'place_and_yaw', 4.0, lambda x: [x[0], x[1], x[2], 0.05**2],
            [0.05, 0.05, 0.005, 0], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def ebike(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of an electric bicycle on hilly roads, pushed by what its crank measures.

    ``mass`` is with the rider, ``area`` the drag area, and ``rolling`` the loss of the tyres.
    """
    mass, area, rolling = physics['mass'], physics['area'], physics['rolling']

    def rates(x: Vector, u: Vector) -> Vector:
        v, slope, _, push = x
        air = 0.6 * area * v * abs(v)
        return (
            (push - air) / mass - GRAVITY * (rolling + slope), -slope / 30.0, v * slope,
            (u[0] - push) / 0.25,
        )  # fmt: skip

    def pedal(t: float, x: Vector) -> Vector:
        return (35.0 + 22.0 * square(t, 19.0) + 12.0 * math.sin(0.8 * t),)

    start = rng.normal([6.0, 0.0, 40.0, 30.0], [0.3, 0.01, 1.0, 5.0])
    density = [0.01, 0.00005, 0, 20.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, pedal, 0.1)
    return {
        'wheel': sampled(truth, 'wheel', 'wheel', 10.0, lambda x: [x[0] / 0.35], [0.3], rng),
        'doppler': sampled(truth, 'gnss_speed', 'speed', 2.0, column(0), [0.15], rng),
        'barometer': sampled(
            truth, 'pressure', 'pressure', 5.0, lambda x: [air_pressure(x[2] + 400.0)], [4.0], rng
        ),
        'accelerometer': sampled(
            truth, 'imu', 'imu', 20.0,
            lambda x: [
                0, 0, 0, (x[3] - 0.6 * area * x[0] * abs(x[0])) / mass - GRAVITY * rolling, 0,
                GRAVITY,
            ],
            [0.01] * 3 + [0.15] * 3, rng,
        ),
        'input': commanded(truth, 'crank', 'force'),
    }  # fmt: skip


def kiwi(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot on three omni wheels in a hall with motion capture.

    ``marker`` is how far the markers are ahead of its centre, and ``least`` the velocity below
    which its drives obey no command.
    """
    marker, least = physics['marker'], physics['least']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, w, ax, ay = x
        c, s, k = math.cos(yaw), math.sin(yaw), 4.0
        dx, dy = ax + w * vy, ay - w * vx
        to_x, to_y = (math.copysign(max(abs(wish) - least, 0.0), wish) for wish in u[:2])
        return (
            c * vx - s * vy, s * vx + c * vy, w, dx, dy, k * (u[2] - w),
            4.0 * k * (k * (to_x - vx) - dx), 4.0 * k * (k * (to_y - vy) - dy),
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return (
            0.3 * square(t, 7.0) + 0.2 * math.sin(0.8 * t),
            0.25 * square(t + 1.0, 5.2) + 0.2 * math.cos(0.5 * t),
            0.5 * square(t, 11.0) + 0.3 * math.sin(1.3 * t),
        )

    def wheels(x: Array) -> list[Array]:
        return [(-math.sin(a) * x[3] + math.cos(a) * x[4] + 0.2 * x[5]) / 0.05 for a in _WHEELS]

    def pose(x: Array) -> list[Array | float]:
        ahead = x[0] + marker * np.cos(x[2]), x[1] + marker * np.sin(x[2])
        return [*ahead, 0.1, 0, 0, x[2], 0, 0, 0]

    start = rng.normal([1.0, -1.0, 0.4, 0, 0, 0, 0, 0], [0.05, 0.05, 0.02] + [0.1] * 5)
    density = [0, 0, 0, 0, 0, 0.01, 0.1, 0.1]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.1)
    return {
        'wheels': sampled(truth, 'wheels', 'three_wheels', 25.0, wheels, [0.3] * 3, rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'mocap': sampled(
            truth, 'mocap', 'pose', 25.0, pose, [0.004] * 3 + [0] * 3 + [0, 0, 0.008], rng
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def hexacopter(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a hexacopter with precise GNSS, a compass and a barometer.

    The readings of its IMU are the input, and means over 10 ms. The antenna is ``antenna`` behind
    the IMU, and the noise of the accelerometer ``shaking`` times that of the file.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    q: Quaternion = exponential(rng.normal([0.05, -0.05, 0.7], 0.03).tolist())
    attitudes, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()

    def turn(t: float) -> list[float]:
        return [0.45 * math.sin(1.4 * t), 0.4 * math.cos(1.1 * t), 0.7 * math.sin(0.4 * t)]

    for t in time.tolist():
        pull = [-sum(s * w**2 * math.sin(w * t) for s, w in sines) for _, *sines in _PATH]
        back = q[0], -q[1], -q[2], -q[3]
        forces.append(rotated(back, [pull[0], pull[1], pull[2] + GRAVITY]))
        rates.append(turn(t))
        attitudes.append(q)
        q = product(q, exponential([step * w for w in turn(t + 0.5 * step)]))
    place = np.array([m + sum(s * np.sin(w * time) for s, w in sines) for m, *sines in _PATH]).T
    moved = np.array([sum(s * w * np.cos(w * time) for s, w in sines) for _, *sines in _PATH]).T
    behind = -physics['antenna'], 0.0, 0.0
    arm = np.array([rotated(each, behind) for each in attitudes])
    swing = np.array(
        [
            rotated(each, (0.0, rate[2] * behind[0], -rate[1] * behind[0]))
            for each, rate in zip(attitudes, rates)
        ]
    )
    ahead = np.array([rotated(each, (1.0, 0.0, 0.0)) for each in attitudes])
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])[:, np.newaxis]

    sensed = np.hstack((rates, forces))
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    imu: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    start, growth = np.repeat([0.005, 0.05], 3), np.repeat([1e-9, 1e-7], 3)
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * growth)
    walk[0] = rng.normal(0.0, start)
    states: Array = np.hstack((place + arm, moved + swing, heading, place[:, 2:]))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    received = commanded(truth, 'imu', 'imu')
    received.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-5, 1e-3], 3) / 0.01)
    received.noise[:, 3:] *= physics['shaking']
    return {
        'gnss': sampled(truth, 'gnss', 'triple', 5.0, lambda x: [*x[:3]], [0.05, 0.05, 0.1], rng),
        'velocity': sampled(
            truth, 'velocity', 'velocity', 5.0, lambda x: [*x[3:6]], [0.1, 0.1, 0.15], rng
        ),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(6), [0.05], rng),
        'barometer': sampled(
            truth, 'pressure', 'pressure', 10.0, lambda x: [air_pressure(x[7] + 400.0)], [5.0], rng
        ),
        'input': received,
    }  # fmt: skip


def cyclist(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a cyclist before a radar at a crossing, a camera, and with a phone."""
    start = rng.normal([60.0, 40.0, -2.0, 1.0], [1.0, 1.0, 0.3, 0.3])
    truth = integrate(
        lambda x, u: (x[2], x[3], 0.0, 0.0), start, [0, 0, 0.03, 0.03], physics['seconds'], 0.01,
        rng,
    )  # fmt: skip

    def radar(x: Array) -> list[Array]:
        distance = np.hypot(x[0], x[1])
        return [distance, np.arctan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / distance]

    return {
        'radar': sampled(truth, 'radar', 'triple', 10.0, radar, [0.4, 0.01, 0.15], rng),
        'camera': sampled(truth, 'camera', 'point', 5.0, lambda x: [x[0], x[1]], [0.4, 0.4], rng),
        'phone': sampled(
            truth, 'fix', 'fix_with_covariance', 1.0, lambda x: [x[0], x[1], 2.0**2],
            [2.0, 2.0, 0], rng,
        ),
    }  # fmt: skip
