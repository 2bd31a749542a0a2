# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a scrubber, a snow groomer, robots on a hull and for football, and a patrol boat.

Inputs are programs of time, or the readings of the IMU; the snow groomer has none.
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

#: Where the wheels of the striker are, from forward to the left.
_WHEELS = tuple(math.radians(degrees) for degrees in (60.0, -60.0, 135.0, -135.0))


def scrubber(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a floor scrubber with a radio tag and a camera at the floor.

    The tag is ``tag`` ahead of the axle and 0.1 m to the left, ``lag`` is that behind commands,
    and from ``halt`` on it is commanded to stand for 25 s.
    """
    tag, lag, halt = physics['tag'], physics['lag'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / lag, turn, (u[1] - turn) / lag
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 25.0:
            return 0.0, 0.0
        speed = 0.6 + 0.3 * square(t, 12.7) + 0.1 * math.sin(0.9 * t)
        return speed, 0.1 + 0.4 * square(t + 2.0, 9.4) + 0.2 * math.sin(0.6 * t)

    def wheels(x: Array) -> list[Array]:
        return [(x[2] + side * 0.5 * x[4]) / 0.1 for side in (-0.5, 0.5)]

    def radio(x: Array) -> list[Array]:
        c, s = np.cos(x[3]), np.sin(x[3])
        return [x[0] + c * tag - s * 0.1, x[1] + s * tag + c * 0.1]

    start = rng.normal([3.0, 1.0, 0.4, 0.9, 0.0], [0.1, 0.1, 0.05, 0.03, 0.05])
    bias = rng.normal(0.0, 0.01)
    truth = integrate(rates, start, [0, 0, 0.01, 0, 0.01], physics['seconds'], 0.005, rng, drive,
                      0.1)  # fmt: skip
    return {
        'wheels': sampled(truth, 'wheels', 'two_wheels', 20.0, wheels, [0.3, 0.3], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'flow': sampled(
            truth, 'flow', 'odometry', 10.0, lambda x: [x[2], x[4]], [0.02, 0.04], rng
        ),
        'ips': sampled(truth, 'ips', 'point', 4.0, radio, [0.08, 0.08], rng),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def snowcat(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a snow groomer on two tracks.

    Its antenna is ``antenna`` ahead of the middle of the tracks, and 0.8 m to the left.
    """
    antenna, decay = physics['antenna'], 1.0 / 3.0

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn, a, _, _ = x
        return v * math.cos(psi), v * math.sin(psi), turn, a, -decay * turn, -decay * a, 0.0, 0.0

    def roof(x: Array) -> list[Array | float]:
        c, s = np.cos(x[2]), np.sin(x[2])
        return [x[0] + c * antenna - s * 0.8, x[1] + s * antenna + c * 0.8, 0.15**2]

    def imu(x: Array) -> list[Array | float]:
        return [0, 0, x[4] + x[6], x[5] + x[7], x[3] * x[4], GRAVITY]

    start = rng.normal(
        [-30.0, 40.0, -0.8, 5.0, 0.0, 0.0, 0.0, 0.0], [0.2, 0.2, 0.03, 0.3, 0.1, 0.2, 0.01, 0.1]
    )
    density = [0, 0, 0, 0, 0.02, 0.08, 1e-10, 1e-7]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng)
    return {
        'gnss': sampled(
            truth, 'fix', 'fix_with_covariance', 5.0, roof, [0.15, 0.15, 0.0], rng
        ),
        'imu': sampled(truth, 'imu', 'imu', 50.0, imu, [0.01] * 3 + [0.15] * 3, rng),
        'sprockets': sampled(
            truth, 'sprockets', 'two_wheels', 10.0,
            lambda x: [(x[3] + side * 2.6 * x[4]) / 0.25 for side in (-0.5, 0.5)], [0.5, 0.5], rng,
        ),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(2), [0.04], rng),
    }  # fmt: skip


def _averaged(sensed: Array) -> Array:
    """Return means over 10 ms of what is sensed every 2.5 ms, by the rule of trapezia."""
    count = len(sensed) - 1
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    means: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    return means


def hullbot(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot that cleans the steep hull of a ship on magnetic wheels.

    A total station follows a prism, ``prism`` ahead of the IMU and 0.3 m above it. The readings
    of the IMU are the input, and means over 10 ms.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    prism = physics['prism'], 0.0, 0.3

    def turn(t: float) -> tuple[float, float, float]:
        return (
            0.06 * math.cos(0.7 * t) + 0.04 * math.cos(2.9 * t),
            0.06 * math.cos(0.5 * t + 0.5) + 0.04 * math.cos(3.3 * t),
            0.5 * math.cos(0.35 * t) + 0.3 * math.cos(1.1 * t + 1.0),
        )

    q: Quaternion = exponential(rng.normal([0.8, 0.1, 0.2], 0.03).tolist())
    speeds = 0.35 + 0.25 * np.sin(0.6 * time) + 0.08 * np.sin(1.7 * time)
    grows = 0.15 * np.cos(0.6 * time) + 0.136 * np.cos(1.7 * time)
    sensed, turns = list[list[float]](), list[Quaternion]()
    for t, speed, growth in zip(time.tolist(), speeds.tolist(), grows.tolist()):
        w = turn(t)
        down = rotated((q[0], -q[1], -q[2], -q[3]), (0.0, 0.0, GRAVITY))
        sensed.append([*w, growth + down[0], w[2] * speed + down[1], -w[1] * speed + down[2]])
        turns.append(q)
        q = product(q, exponential([step * rate for rate in turn(t + 0.5 * step)]))
    moved = np.array([rotated(q, (v, 0.0, 0.0)) for q, v in zip(turns, speeds.tolist())])
    place = rng.normal([2.0, 6.0, 4.0], 0.03) + np.vstack(
        (np.zeros(3), np.cumsum(0.5 * step * (moved[1:] + moved[:-1]), axis=0))
    )
    a, b, c, d = np.array(turns).T
    roll = np.arctan2(2.0 * (a * b + c * d), 1.0 - 2.0 * (b * b + c * c))
    pitch = np.arcsin(2.0 * (a * c - d * b))
    arm = np.array([rotated(q, prism) for q in turns])
    states = np.column_stack((place + arm, speeds, roll, pitch))
    imu = _averaged(np.array(sensed))
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * np.repeat([1e-9, 1e-7], 3))
    walk[0] = rng.normal(0.0, np.repeat([0.005, 0.05], 3))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    heard = commanded(truth, 'imu', 'imu')
    heard.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-5, 1e-3], 3) / 0.01)
    return {
        'station': sampled(
            truth, 'station', 'triple', 4.0, lambda x: [*x[:3]], [0.01] * 3, rng
        ),
        'wheels': sampled(
            truth, 'wheels', 'velocity', 20.0, lambda x: [x[3], 0, 0], [0.03] * 3, rng
        ),
        'level': sampled(
            truth, 'level', 'attitude', 10.0, lambda x: [x[4], x[5], 0], [0.02, 0.02, 0], rng
        ),
        'input': heard,
    }  # fmt: skip


def striker(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a robot that plays football, below a camera.

    It has four wheels that roll to their sides, and ``lag`` is that behind commands. Below
    ``least`` a command does nothing, and ``shoves`` is the density of pushes by that of the file.
    """
    k, least, shoves = 1.0 / physics['lag'], physics['least'], physics['shoves']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, turn, ax, ay = x
        c, s, growth, fall = math.cos(yaw), math.sin(yaw), ax + turn * vy, ay - turn * vx
        forward, left, about = (math.copysign(max(abs(n) - least, 0.0), n) for n in u)
        return (
            c * vx - s * vy, s * vx + c * vy, turn, growth, fall, k * (about - turn),
            4.0 * k * (k * (forward - vx) - growth), 4.0 * k * (k * (left - vy) - fall),
        )  # fmt: skip

    def play(t: float, x: Vector) -> Vector:
        return (
            1.1 * square(t, 3.1) + 0.5 * math.sin(1.7 * t),
            0.9 * square(t + 0.6, 4.3) + 0.5 * math.cos(2.2 * t),
            1.3 * square(t + 0.3, 3.7) + 0.8 * math.sin(2.9 * t),
        )

    def wheels(x: Array) -> list[Array]:
        return [(-math.sin(a) * x[3] + math.cos(a) * x[4] + 0.08 * x[5]) / 0.03 for a in _WHEELS]

    start = rng.normal([-1.0, 0.5, 0.4, *[0.0] * 5], [0.02, 0.02, 0.02, *[0.1] * 5])
    density = [0, 0, 0, 0, 0, 0.1, 1.0 * shoves, 1.0 * shoves]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, play, 0.04)
    return {
        'wheels': sampled(truth, 'wheels', 'mecanum', 50.0, wheels, [1.5] * 4, rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY],
            [0.02] * 3 + [0.05] * 3, rng,
        ),
        'camera': sampled(
            truth, 'ssl', 'pose', 25.0, lambda x: [x[0], x[1], 0, 0, 0, x[2], 0, 0, 0],
            [0.006, 0.006, *[0.0] * 6, 0.01], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def patrol(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return four minutes of a patrol boat that follows another one, by camera and radar.

    The state is that of the other relative to it, and its acceleration is the input. The other
    changes its velocity with ``zigzag`` of the density of the file.
    """

    def rates(x: Vector, u: Vector) -> Vector:
        return x[2], x[3], -u[0], -u[1]

    def steer(t: float, x: Vector) -> Vector:
        return (
            0.35 * math.cos(0.08 * t) + 0.12 * math.cos(0.31 * t),
            0.30 * math.cos(0.11 * t + 1.57) + 0.12 * math.cos(0.27 * t + 1.57),
        )

    def radar(x: Array) -> list[Array]:
        distance = np.hypot(x[0], x[1])
        return [
            distance, np.arctan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / distance
        ]  # fmt: skip

    # the other starts by what makes the mean relative velocity small
    start = rng.normal([180.0, 320.0, 0.2, -3.2], [5.0, 5.0, 0.15, 0.15])
    density = [0, 0, 0.001 * physics['zigzag'], 0.001 * physics['zigzag']]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, steer, 0.1)
    return {
        'camera': sampled(
            truth, 'camera', 'point', 10.0, lambda x: [np.arctan2(x[1], x[0]), 0], [0.004, 0], rng
        ),
        'radar': sampled(truth, 'radar', 'triple', 1.0, radar, [2.5, 0.012, 0.15], rng),
        'ais': sampled(truth, 'ais', 'point', 1 / 4, lambda x: [*x[:2]], [4.0, 4.0], rng),
        'input': commanded(truth, 'acceleration', 'shove'),
    }
