# SPDX-License-Identifier: Apache-2.0
"""Vehicles: an underwater robot, a wheel loader, an AGV, a jet ski, a bed and a hot-air balloon.

Inputs are programs of time, or the readings of the IMU; the jet ski and the bed have none.
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

#: The path of the underwater robot: of each coordinate the mean, and sizes and rates of two sines.
_PATH = (
    (4.0, (12.0, 0.17), (0.8, 0.9)),
    (-3.0, (8.0, 0.23), (0.7, 1.1)),
    (-18.0, (4.0, 0.21), (0.4, 0.8)),
)
#: Where the two reflectors of the AGV are.
_REFLECTORS = (-3.0, 9.0), (14.0, -2.0)


def inspector(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot that hovers under water, with a Doppler log and a place by sound.

    The readings of its IMU are the input, and means over 10 ms. Its transponder is ``ahead``.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    q: Quaternion = exponential(rng.normal([0.03, 0.08, -0.9], 0.03).tolist())
    attitudes, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()

    def turn(t: float) -> list[float]:
        return [0.2 * math.sin(0.9 * t), 0.15 * math.cos(0.7 * t), 0.5 * math.sin(0.3 * t + 0.5)]

    for t in time.tolist():
        pull = [-sum(s * w**2 * math.sin(w * t) for s, w in sines) for _, *sines in _PATH]
        back = q[0], -q[1], -q[2], -q[3]
        forces.append(rotated(back, [pull[0], pull[1], pull[2] + GRAVITY]))
        rates.append(turn(t))
        attitudes.append(q)
        q = product(q, exponential([step * w for w in turn(t + 0.5 * step)]))
    place = np.array([m + sum(s * np.sin(w * time) for s, w in sines) for m, *sines in _PATH]).T
    moved = np.array([sum(s * w * np.cos(w * time) for s, w in sines) for _, *sines in _PATH]).T
    offset, speed = rng.normal(0.0, [0.3, 0.3, 0.2]), rng.normal(0.0, 0.1, 3)
    place, moved = place + offset + time[:, np.newaxis] * speed, moved + speed
    of_body = np.array(
        [rotated((a, -b, -c, -d), v) for (a, b, c, d), v in zip(attitudes, moved.tolist())]
    )
    arm = np.array([rotated(each, (physics['ahead'], 0.0, 0.0)) for each in attitudes])
    nose = np.array([rotated(each, (1.0, 0.0, 0.0)) for each in attitudes])
    heading = np.arctan2(nose[:, 1], nose[:, 0])[:, np.newaxis]

    sensed = np.hstack((rates, forces))
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    imu: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    start, growth = np.repeat([0.005, 0.05], 3), np.repeat([1e-9, 1e-7], 3)
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * growth)
    walk[0] = rng.normal(0.0, start)
    states: Array = np.hstack((place + arm, of_body, heading, place[:, 2:]))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    received = commanded(truth, 'imu', 'imu')
    received.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-5, 1e-3], 3) / 0.01)
    return {
        'dvl': sampled(truth, 'dvl', 'velocity', 5.0, lambda x: [*x[3:6]], [0.02] * 3, rng),
        'usbl': sampled(truth, 'usbl', 'triple', 1.0, lambda x: [*x[:3]], [0.4] * 3, rng),
        'depth': sampled(
            truth, 'depth', 'pressure', 10.0, lambda x: [101325.0 - 1025.0 * GRAVITY * x[7]],
            [500.0], rng,
        ),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(6), [0.04], rng),
        'input': received,
    }  # fmt: skip


def loader(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a wheel loader that is steered by its joint; the place is its front axle.

    The antenna is ``antenna`` ahead of this axle, and the other one ``rear`` behind the joint.
    ``stuck`` is the rate of the joint below which its valve obeys no command.
    """
    antenna, rear, stuck = physics['antenna'], physics['rear'], physics['stuck']

    def turning(v: Array | float, joint: Array | float, rate: Array | float) -> Array:
        return np.asarray((v * np.sin(joint) + rear * rate) / (1.5 * np.cos(joint) + rear))

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, joint, rate = x
        wish = math.copysign(max(abs(u[1]) - stuck, 0.0), u[1])
        turn = (v * math.sin(joint) + rear * rate) / (1.5 * math.cos(joint) + rear)
        return (
            v * math.cos(psi), v * math.sin(psi), turn, (u[0] - v) / 0.8, rate,
            (wish - rate) / 0.3,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return (
            1.2 + 0.8 * square(t, 23.0) + 0.4 * math.sin(0.5 * t),
            0.11 * square(t, 10.0) + 0.05 * math.sin(1.1 * t),
        )

    def roof(x: Array) -> list[Array]:
        return [x[0] + antenna * np.cos(x[2]), x[1] + antenna * np.sin(x[2])]

    start = rng.normal([5.0, -8.0, 0.9, 1.0, -0.28, 0.0], [0.1, 0.1, 0.1, 0.1, 0.02, 0.02])
    density = [0, 0, 0, 0.01, 0, 0.0005]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, drive, 0.1)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, roof, [0.05, 0.05], rng),
        'drum': sampled(truth, 'drum', 'drum', 20.0, lambda x: [x[3] / 0.7], [0.1], rng),
        'joint': sampled(truth, 'joint', 'hitch', 20.0, column(4), [0.01], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, turning(x[3], x[4], x[5]), 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'input': commanded(truth, 'cmd', 'drive'),
    }  # fmt: skip


def agv(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of an AGV whose scanner sees two reflectors.

    The second of these is at ``x_b``, and its turns are ``weak`` times those that are commanded.
    From ``halt`` on it is told to stand for 20 s.
    """
    weak, halt = physics['weak'], physics['halt']
    places = _REFLECTORS[0], (physics['x_b'], _REFLECTORS[1][1])

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.35, turn,
            (weak * u[1] - turn) / 0.35,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 20.0:
            return 0.0, 0.0
        return 0.8 + 0.35 * square(t, 13.0), 0.5 + 0.35 * square(t, 8.0) + 0.2 * math.sin(1.2 * t)

    def scan(x: Array) -> list[Array]:
        c, s = np.cos(x[3]), np.sin(x[3])
        numbers = []
        for east, north in places:
            dx, dy = east - x[0], north - x[1]
            numbers += [np.hypot(dx, dy), np.arctan2(c * dy - s * dx, c * dx + s * dy)]
        return numbers

    start = rng.normal([6.0, 4.0, 0.7, 0.3, 0.3], [0.1, 0.1, 0.1, 0.03, 0.05])
    bias = rng.normal(0.0, 0.02)
    truth = integrate(
        rates, start, [0, 0, 0.01, 0, 0.01], physics['seconds'], 0.005, rng, drive, 0.1
    )
    return {
        'odom': sampled(
            truth, 'odom', 'odometry', 25.0, lambda x: [x[2], x[4]], [0.03, 0.03], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.008] * 3 + [0.05] * 3, rng,
        ),
        'scanner': sampled(
            truth, 'reflectors', 'reflectors', 10.0, scan, [0.03, 0.008] * 2, rng
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def jetski(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a jet ski that somebody rides at will, before a radar on the shore.

    Its IMU has unknown biases, and its antenna is ``antenna`` ahead of the IMU.
    """
    antenna = physics['antenna']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn, a = x
        return v * math.cos(psi), v * math.sin(psi), turn, a, -turn / 3.0, -a / 3.0

    def aerial(x: Array) -> list[Array | float]:
        return [x[0] + antenna * np.cos(x[2]), x[1] + antenna * np.sin(x[2]), 0.6**2]

    def radar(x: Array) -> list[Array]:
        distance, ahead = np.hypot(x[0], x[1]), x[3] * np.cos(x[2] - np.arctan2(x[1], x[0]))
        return [distance, np.arctan2(x[1], x[0]), ahead]

    start = rng.normal([350.0, 250.0, 1.9, 9.0, 0.0, 0.0], [1.0, 1.0, 0.1, 0.5, 0.1, 0.3])
    turn_bias, bias = rng.normal(0.0, [0.01, 0.1])
    density = [0, 0, 0, 0, 0.03, 0.2]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng)
    return {
        'gnss': sampled(truth, 'fix', 'fix_with_covariance', 5.0, aerial, [0.6, 0.6, 0], rng),
        'imu': sampled(
            truth, 'imu', 'imu_with_covariance', 50.0,
            lambda x: [0, 0, x[4] + turn_bias, x[5] + bias, 0, GRAVITY, 1e-4, 0.0225],
            [0.01] * 3 + [0.15] * 3 + [0, 0], rng,
        ),
        'log': sampled(truth, 'log', 'speed', 10.0, column(3), [0.25], rng),
        'radar': sampled(truth, 'radar', 'triple', 4.0, radar, [1.5, 0.01, 0.3], rng),
    }  # fmt: skip


def bed(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a hospital bed on casters, with two optical mice and a camera above.

    The rear mouse is ``behind`` the middle, and ``rough`` the density of the pushes by the file's.
    """
    behind, rough = physics['behind'], physics['rough']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, w, ax, ay = x
        c, s = math.cos(yaw), math.sin(yaw)
        return c * vx - s * vy, s * vx + c * vy, w, ax + w * vy, ay - w * vx, 0.0, 0.0, 0.0

    start = rng.normal(
        [3.0, 2.0, 0.7, 0.4, 0, 0.1, 0, 0], [0.05, 0.05, 0.02, 0.1, 0.1, 0.05, 0.03, 0.03]
    )
    density = [0, 0, 0, *(rough * np.array([0.01, 0.01, 0.005])), 1e-5, 1e-5]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng)
    return {
        'front': sampled(
            truth, 'front', 'planar', 50.0, lambda x: [x[3], x[4] + 0.8 * x[5]], [0.03] * 2, rng
        ),
        'rear': sampled(
            truth, 'rear', 'planar', 50.0, lambda x: [x[3], x[4] - behind * x[5]], [0.03] * 2, rng
        ),
        'camera': sampled(
            truth, 'camera', 'pose', 10.0, lambda x: [x[0], x[1], 0, 0, 0, x[2], 0, 0, 0],
            [0.015] * 2 + [0] * 6 + [0.01], rng,
        ),
    }  # fmt: skip


def aerostat(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return five minutes of a hot-air balloon, whose height its pilot changes by the burner.

    ``level`` is the warmth of the air inside at which it floats, ``burner`` what a full flame
    warms in a second, and ``loss`` the time in which it cools.
    """
    level, burner, loss = physics['level'], physics['burner'], physics['loss']

    def rates(x: Vector, u: Vector) -> Vector:
        _, climb, warmth = x
        return (
            climb, 0.03 * (warmth - level) - 0.04 * climb * abs(climb),
            burner * u[0] - warmth / loss,
        )  # fmt: skip

    def burn(t: float, x: Vector) -> Vector:
        return (0.39 + 0.33 * square(t, 58.0) + 0.05 * math.sin(0.37 * t),)

    start = rng.normal([420.0, 0.3, 68.0], [1.0, 0.2, 1.0])
    truth = integrate(rates, start, [0, 0.004, 0.04], physics['seconds'], 0.02, rng, burn, 0.2)
    return {
        'barometer': sampled(
            truth, 'pressure', 'pressure', 5.0, lambda x: [air_pressure(x[0])], [8.0], rng
        ),
        'gnss': sampled(truth, 'fix', 'altitude', 1.0, column(0), [1.5], rng),
        'vario': sampled(truth, 'vario', 'climb', 5.0, column(1), [0.12], rng),
        'crown': sampled(
            truth, 'crown', 'temperature', 2.0, lambda x: [x[2] + 18.0 - 0.0065 * x[0]], [0.6], rng
        ),
        'input': commanded(truth, 'burner', 'number'),
    }  # fmt: skip
