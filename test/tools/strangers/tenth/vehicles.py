# SPDX-License-Identifier: Apache-2.0
"""Vehicles and targets: a porter, a truck, a drone in a mine, a swerve drive, and two targets.

Inputs are programs of time, or the readings of the IMU; the truck and the targets have none.
"""

from __future__ import annotations

import math

import numpy as np

from ..eighth.vehicles import air_pressure
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

#: The path of the drone: of each coordinate the mean, and sizes and rates of two sines.
_PATH = (
    (0.5, (3.5, 0.31), (0.5, 1.1)),
    (-0.5, (3.0, 0.43), (0.4, 1.3)),
    (2.0, (0.8, 0.37), (0.2, 0.9)),
)
#: Where the three markers in the mine are.
_MARKERS = (13.0, 1.0, 3.0), (-4.0, 11.0, 1.0), (-6.0, -9.0, 4.0)


def porter(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a hospital robot that sees marks at the ceiling.

    Its camera is ``ahead`` of the middle of its axle, and ``rough`` is the density of all pushes
    by that of the file. From ``halt`` on it is told to stand for 25 s.
    """
    ahead, rough, halt = physics['ahead'], physics['rough'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.45, turn, (u[1] - turn) / 0.45,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 25.0:
            return 0.0, 0.0
        return 0.7 + 0.3 * square(t, 9.0), 0.1 + 0.4 * square(t, 7.0) + 0.25 * math.sin(0.9 * t)

    def ceiling(x: Array) -> list[Array | float]:
        return [x[0] + ahead * np.cos(x[3]), x[1] + ahead * np.sin(x[3]), x[3], 0.03**2]

    start = rng.normal([2.0, -3.0, 0.8, 0.5, 0.2], [0.1, 0.1, 0.1, 0.03, 0.05])
    bias = rng.normal(0.0, 0.015)
    density = [0, 0, 0.012 * rough, 0, 0.015 * rough]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)
    return {
        'odom': sampled(
            truth, 'odom', 'odometry', 20.0, lambda x: [x[2], x[4]], [0.025, 0.03], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'camera': sampled(
            truth, 'marks', 'place_and_yaw', 5.0, ceiling, [0.03, 0.03, 0.003, 0], rng
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def truck(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a truck on roads, whose IMU has unknown biases.

    Its antenna is ``antenna`` ahead of the IMU, which sees accelerations to the left, too.
    """
    antenna = physics['antenna']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn, a = x
        return v * math.cos(psi), v * math.sin(psi), turn, a, -0.25 * turn, -0.25 * a

    def roof(x: Array) -> list[Array]:
        return [x[0] + antenna * np.cos(x[2]), x[1] + antenna * np.sin(x[2])]

    start = rng.normal([-150.0, 80.0, 0.4, 14.0, 0.0, 0.0], [1.0, 1.0, 0.03, 0.3, 0.05, 0.2])
    turn_bias, bias = rng.normal(0.0, [0.01, 0.1])
    density = [0, 0, 0, 0, 0.002, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, roof, [0.5, 0.5], rng),
        'imu': sampled(
            truth, 'imu', 'imu', 50.0,
            lambda x: [0, 0, x[4] + turn_bias, x[5] + bias, x[3] * x[4], GRAVITY],
            [0.005] * 3 + [0.1] * 3, rng,
        ),
        'tacho': sampled(truth, 'tacho', 'speed', 10.0, column(3), [0.15], rng),
        'heading': sampled(truth, 'heading', 'compass', 10.0, column(2), [0.02], rng),
    }  # fmt: skip


def _averaged(sensed: Array) -> Array:
    """Return means over 10 ms of what is sensed every 2.5 ms, by the rule of trapezia."""
    count = len(sensed) - 1
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    means: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    return means


def miner(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a drone in a mine, with a camera that sees three markers.

    The readings of its IMU are the input, and means over 10 ms. The third marker is at ``x_c``.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)

    def turn(t: float) -> list[float]:
        # of roll and pitch, which are small, and yaw, one after the other
        roll, pitch = 0.15 * math.sin(1.1 * t), 0.12 * math.sin(0.8 * t)
        rolling, pitching = 0.165 * math.cos(1.1 * t), 0.096 * math.cos(0.8 * t)
        yawing = 0.5 * math.cos(0.35 * t) + 0.3 * math.cos(0.9 * t)
        c, s, flat = math.cos(roll), math.sin(roll), yawing * math.cos(pitch)
        return [
            rolling - yawing * math.sin(pitch),
            pitching * c + flat * s,
            flat * c - pitching * s,
        ]

    q: Quaternion = exponential(rng.normal([0.0, 0.0, 0.6], 0.03).tolist())
    turns, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()
    for t in time.tolist():
        pull = [-sum(s * w**2 * math.sin(w * t) for s, w in sines) for _, *sines in _PATH]
        forces.append(rotated((q[0], -q[1], -q[2], -q[3]), [*pull[:2], pull[2] + GRAVITY]))
        rates.append(turn(t))
        turns.append(q)
        q = product(q, exponential([step * w for w in turn(t + 0.5 * step)]))
    place = np.array([m + sum(s * np.sin(w * time) for s, w in sines) for m, *sines in _PATH]).T
    moved = np.array([sum(s * w * np.cos(w * time) for s, w in sines) for _, *sines in _PATH]).T
    speed = rng.normal(0.0, 0.02, 3)
    place += rng.normal(0.0, 0.1, 3) + time[:, np.newaxis] * speed
    moved += speed

    def of_body(vectors: Array) -> Array:
        return np.array([rotated((a, -b, -c, -d), v) for (a, b, c, d), v in zip(turns, vectors)])

    third = physics['x_c'], *_MARKERS[2][1:]
    seen = [of_body(np.array(marker) - place) for marker in (*_MARKERS[:2], third)]
    states = np.hstack((place, of_body(moved), *seen))

    def look(x: Array) -> list[Array]:
        numbers = []
        for k in (6, 9, 12):
            across = np.hypot(x[k], x[k + 1])
            angles = np.arctan2(x[k + 1], x[k]), np.arctan2(x[k + 2], across)
            numbers += [np.hypot(across, x[k + 2]), *angles]
        return numbers

    imu = _averaged(np.hstack((rates, forces)))
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * np.repeat([1e-9, 1e-7], 3))
    walk[0] = rng.normal(0.0, np.repeat([0.005, 0.05], 3))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    heard = commanded(truth, 'imu', 'imu')
    heard.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([2e-5, 2e-3], 3) / 0.01)
    return {
        'markers': sampled(truth, 'markers', 'markers', 5.0, look, [0.05, 0.01, 0.01] * 3, rng),
        'flow': sampled(truth, 'flow', 'velocity', 10.0, lambda x: [*x[3:6]], [0.05] * 3, rng),
        'barometer': sampled(
            truth, 'pressure', 'pressure', 10.0, lambda x: [air_pressure(x[2])], [5.0], rng
        ),
        'input': heard,
    }


def swerve(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot with four steered wheels, which sees tags on the walls.

    ``least`` is the size of a command below which its drives do nothing. From ``halt`` on it is
    told to stand for 15 s.
    """
    least, halt = physics['least'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, turn, ax, ay = x
        forward, left, about = (math.copysign(max(abs(w) - least, 0.0), w) for w in u)
        c, s, growth, fall = math.cos(yaw), math.sin(yaw), ax + turn * vy, ay - turn * vx
        return (
            c * vx - s * vy, s * vx + c * vy, turn, growth, fall, 5.0 * (about - turn),
            100.0 * (forward - vx) - 20.0 * growth, 100.0 * (left - vy) - 20.0 * fall,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 15.0:
            return 0.0, 0.0, 0.0
        return (
            0.8 * square(t, 6.2) + 0.5 * math.sin(0.7 * t),
            0.7 * square(t + 1.0, 4.6) + 0.4 * math.cos(1.1 * t),
            0.9 * square(t + 2.0, 7.4) + 0.5 * math.sin(0.9 * t),
        )

    start = rng.normal([4.0, 2.0, 0.3, *[0.0] * 5], [0.05, 0.05, 0.02, *[0.1] * 5])
    density = [0, 0, 0, 0, 0, 0.02, 0.4, 0.4]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.05)
    return {
        'odom': sampled(
            truth, 'odom', 'legs', 50.0, lambda x: [*x[3:6]], [0.04, 0.04, 0.05], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'tags': sampled(
            truth, 'tags', 'place_and_yaw', 10.0, lambda x: [*x[:3], 0.04**2],
            [0.04, 0.04, 0.004, 0], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def airliner(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of an aeroplane that taxies, with a radar, receivers, and its own report.

    ``rough`` is the density of the changes of its speed by that of the file.
    """

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return v * math.cos(psi), v * math.sin(psi), 0.0, turn, 0.0

    def radar(x: Array) -> list[Array]:
        bearing = np.arctan2(x[1], x[0])
        return [np.hypot(x[0], x[1]), bearing, x[2] * np.cos(x[3] - bearing)]

    start = rng.normal([700.0, 500.0, 9.0, 2.2, 0.0], [3.0, 3.0, 0.3, 0.05, 0.01])
    density = [0, 0, 0.05 * physics['rough'], 0, 3e-5]
    truth = integrate(rates, start, density, physics['seconds'], 0.02, rng)
    return {
        'mlat': sampled(truth, 'mlat', 'point', 2.0, lambda x: [x[0], x[1]], [3.0, 3.0], rng),
        'radar': sampled(truth, 'radar', 'triple', 1.0, radar, [4.0, 0.004, 0.4], rng),
        'adsb': sampled(
            truth, 'adsb', 'speed_and_heading', 2.0, lambda x: [x[2], x[3]], [0.3, 0.02], rng
        ),
    }


def swimmer(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a swimmer before a camera and a sonar, who wears a tag."""

    def rates(x: Vector, u: Vector) -> Vector:
        return x[2], x[3], 0.0, 0.0

    def sonar(x: Array) -> list[Array]:
        distance = np.hypot(x[0], x[1])
        return [distance, np.arctan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / distance]

    start = rng.normal([55.0, 40.0, 0.4, -0.5], [0.5, 0.5, 0.2, 0.2])
    truth = integrate(rates, start, [0, 0, 0.002, 0.002], physics['seconds'], 0.02, rng)
    return {
        'camera': sampled(truth, 'camera', 'point', 5.0, lambda x: [x[0], x[1]], [0.2] * 2, rng),
        'sonar': sampled(truth, 'sonar', 'triple', 2.0, sonar, [0.2, 0.01, 0.08], rng),
        'tag': sampled(truth, 'tag', 'planar', 5.0, lambda x: [x[2], x[3]], [0.12] * 2, rng),
    }
