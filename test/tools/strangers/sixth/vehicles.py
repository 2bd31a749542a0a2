# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a mower, a legged robot, a bus, a kite on a tether, and a sailing boat.

Inputs are programs of time, or the readings of an IMU; the legged robot and the bus have none.
"""

from __future__ import annotations

import math

import numpy as np

from ..fifth.rotations import Quaternion, exponential, logarithm, product, rotated
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

#: The field of the Earth in T: east, north and up.
_FIELD = 1.2e-6, 2e-5, -4.5e-5
#: The middle in m, and the amplitudes and rates in rad/s of two sines, of each coordinate.
_FIGURE = (
    (45.0, (9.0, 0.55), (0.4, 2.1)), (0.0, (18.0, 0.4), (0.5, 2.6)), (35.0, (7.0, 0.8), (0.3, 3.1))
)  # fmt: skip


def mower(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a robot that mows in lanes, with corrected GNSS.

    Its antenna is ``antenna`` ahead of the axle, and its gyro has an unknown bias.
    """
    ahead = physics['antenna']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.4, turn, (u[1] - turn) / 0.4

    def mow(t: float, x: Vector) -> Vector:
        lane, since = divmod(t, 13.0)
        side = 1.0 if lane % 2.0 else -1.0
        return (0.55, 0.12 * math.sin(0.9 * t)) if since < 9.0 else (0.3, 0.8 * side)

    def wheels(x: Array) -> list[Array]:
        return [(x[2] - 0.18 * x[4]) / 0.11, (x[2] + 0.18 * x[4]) / 0.11]

    def antenna(x: Array) -> list[Array | float]:
        return [x[0] + ahead * np.cos(x[3]), x[1] + ahead * np.sin(x[3]), 0.03**2]

    start = rng.normal([4.0, -3.0, 0.3, 0.5, 0.0], [0.1, 0.1, 0.1, 0.05, 0.05])
    bias = rng.normal(0.0, 0.02)
    density = [0, 0, 0.005, 0, 0.005]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, mow, 0.1)
    return {
        'wheels': sampled(truth, 'wheels', 'two_wheels', 20.0, wheels, [0.4, 0.4], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'gnss': sampled(truth, 'fix', 'fix_with_covariance', 5.0, antenna, [0.03, 0.03, 0], rng),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def dog(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return seconds of a robot on four legs, with odometry by these, an IMU and a lidar.

    The lidar is ``ahead`` of the middle of the body, and turned by ``turned`` about the vertical.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    speed, turning = [0.01, 0.005, 0.001], [2e-5, 2e-5, 4e-3]
    density = np.array([*speed, *turning, 5e-5, 5e-5, 1e-5])
    pushes = rng.standard_normal((count, 9)) * np.sqrt(step * density)
    q: Quaternion = exponential(rng.normal([0, 0, 0.6], [0.02, 0.02, 0.05]).tolist())
    p = rng.normal([2.0, 1.0, 0.5], 0.05)
    v, w, a = (
        rng.normal(m, s) for m, s in (([0.5, 0, 0], 0.05), ([0, 0, 0], 0.02), ([0] * 3, 0.02))
    )
    shape = exponential((0.0, 0.0, physics['turned']))
    states = list[list[float]]()
    for k in range(count + 1):
        back = q[0], -q[1], -q[2], -q[3]
        up = np.array(rotated(back, (0.0, 0.0, GRAVITY)))
        seen = p + rotated(q, (physics['ahead'], 0.0, 0.0))
        states.append([*seen, *logarithm(product(q, shape)), *v, *w, *(a + up)])
        if k == count:
            break
        middle = product(q, exponential((0.5 * step * w).tolist()))
        half = v + 0.5 * step * (a - np.cross(w, v))
        p = p + step * np.array(rotated(middle, half.tolist()))
        q = product(q, exponential((step * w).tolist()))
        v = v + step * (a - np.cross(w, half)) + pushes[k, :3]
        w, a = w + pushes[k, 3:6], a + pushes[k, 6:]
    truth = Track(time, np.array(states), time[:0], np.zeros((0, 0)))
    return {
        'legs': sampled(truth, 'legs', 'velocity', 50.0, lambda x: [*x[6:9]], [0.06] * 3, rng),
        'imu': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [*x[9:15]], [0.01] * 3 + [0.1] * 3, rng
        ),
        'lidar': sampled(
            truth, 'pose', 'pose', 10.0, lambda x: [*x[:6], 0, 0, 0],
            [0.03] * 3 + [0] * 3 + [0.01] * 3, rng,
        ),
    }  # fmt: skip


def bus(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return ten minutes of a bus, with GNSS, a heading by two antennas, odometer and gyro."""

    def rates(x: Vector, u: Vector) -> Vector:
        return x[2] * math.cos(x[3]), x[2] * math.sin(x[3]), 0.0, x[4], 0.0

    start = rng.normal([50.0, 20.0, 11.0, 1.0, 0.0], [3.0, 3.0, 1.0, 0.1, 0.02])
    bias = rng.normal(0.0, 0.01)
    truth = integrate(rates, start, [0, 0, 0.03, 0, 2e-5], physics['seconds'], 0.02, rng)
    return {
        'gnss': sampled(
            truth, 'fix', 'fix_with_covariance', 1.0, lambda x: [x[0], x[1], 1.5**2],
            [1.5, 1.5, 0], rng,
        ),
        'heading': sampled(truth, 'heading', 'compass', 1.0, column(3), [0.02], rng),
        'odometer': sampled(truth, 'odometer', 'speed', 5.0, column(2), [0.15], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 10.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.006] * 3 + [0.1] * 3, rng,
        ),
    }  # fmt: skip


def kite(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a kite that flies eights, with an IMU, GNSS and the length of its tether.

    The readings of its IMU are the input, and means over 10 ms. The antenna is ``antenna`` to the
    left of the IMU, and the winch at ``winch`` along x.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    q: Quaternion = exponential(rng.normal([0.2, -0.1, 1.2], 0.05).tolist())
    attitudes, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()

    def turn(t: float) -> list[float]:
        return [0.7 * math.sin(0.8 * t), 0.6 * math.cos(1.1 * t), 0.8 * math.sin(0.5 * t + 0.4)]

    for t in time.tolist():
        pull = [-sum(s * w**2 * math.sin(w * t) for s, w in sines) for _, *sines in _FIGURE]
        back = q[0], -q[1], -q[2], -q[3]
        forces.append(rotated(back, [pull[0], pull[1], pull[2] + GRAVITY]))
        rates.append(turn(t))
        attitudes.append(q)
        q = product(q, exponential([step * w for w in turn(t + 0.5 * step)]))
    place = np.array([m + sum(s * np.sin(w * time) for s, w in sines) for m, *sines in _FIGURE]).T
    left = np.array([rotated(each, (0.0, physics['antenna'], 0.0)) for each in attitudes])
    field = [rotated((a, -b, -c, -d), _FIELD) for a, b, c, d in attitudes]
    tether = np.linalg.norm(place - [physics['winch'], 0.0, 0.0], axis=1)

    sensed = np.hstack((rates, forces))
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    imu: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    start, growth = np.repeat([0.005, 0.05], 3), np.repeat([1e-9, 1e-7], 3)
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * growth)
    walk[0] = rng.normal(0.0, start)
    states: Array = np.hstack((place + left, field, tether[:, np.newaxis]))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    received = commanded(truth, 'imu', 'imu')
    received.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-5, 1e-3], 3) / 0.01)
    return {
        'gnss': sampled(truth, 'gnss', 'triple', 5.0, lambda x: [*x[:3]], [0.3, 0.3, 0.5], rng),
        'magnetometer': sampled(
            truth, 'field', 'field', 20.0, lambda x: [*x[3:6]], [1e-6] * 3, rng
        ),
        'tether': sampled(truth, 'tether', 'range', 10.0, column(6), [0.15], rng),
        'input': received,
    }


def sailboat(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a sailing boat whose vane feels the apparent wind.

    ``drag`` is that of the hull, and ``rudder`` what the rudder does by what it should.
    """
    drag, rudder = physics['drag'], physics['rudder']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, turn, v, to_x, to_y = x
        c, s = math.cos(psi), math.sin(psi)
        across = to_y * c - to_x * s
        side = 0.03 * across
        return (
            v * c - side * s, v * s + side * c, turn, (0.35 * rudder * v * u[0] - turn) / 1.5,
            0.01 * across**2 - drag * v * abs(v), 0.0, 0.0,
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        return (0.14 * square(t, 44.0) + 0.1 * math.sin(0.5 * t),)

    def vane(x: Array) -> list[Array]:
        c, s = np.cos(x[2]), np.sin(x[2])
        ahead, left = x[5] * c + x[6] * s - x[4], x[6] * c - x[5] * s
        return [np.hypot(ahead, left), np.arctan2(left, ahead)]

    start = rng.normal([0, 0, 0.3, 0, 2, 1.0, 6.5], [0.5, 0.5, 0.05, 0.03, 0.2, 0.5, 0.5])
    density = [0, 0, 0, 0.00003, 0.001, 0.0005, 0.0005]
    truth = integrate(rates, start, density, physics['seconds'], 0.02, rng, steer, 0.2)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 2.0, lambda x: [x[0], x[1]], [0.8, 0.8], rng),
        'compass': sampled(truth, 'compass', 'compass', 5.0, column(2), [0.03], rng),
        'log': sampled(truth, 'log', 'speed', 5.0, column(4), [0.08], rng),
        'vane': sampled(truth, 'vane', 'drive', 5.0, vane, [0.3, 0.05], rng),
        'input': commanded(truth, 'rudder', 'steering'),
    }
