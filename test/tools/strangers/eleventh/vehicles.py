# SPDX-License-Identifier: Apache-2.0
"""Vehicles and a person: a vacuum cleaner, a picker, a skidder, a backpack, and a barge.

Inputs are programs of time, or the readings of the IMU; the skidder and the barge have none.
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

#: Where the three beacons of the vacuum cleaner are.
_BEACONS = (5.0, 1.0), (-3.5, 4.5), (-1.0, -5.0)
#: Where the four radio anchors of the building site are.
_ANCHORS = (8.0, 7.0, 4.5), (-7.0, 8.0, 0.6), (-8.0, -7.0, 5.0), (7.0, -8.0, 1.0)
#: East, north and up, in T.
_FIELD = 1.2e-6, 2.0e-5, -4.5e-5
#: The path of the backpack: of each coordinate the mean, and sizes and rates of two sines.
_PATH = (
    (0.3, (3.2, 0.37), (0.3, 1.7)),
    (-0.4, (2.8, 0.29), (0.3, 1.5)),
    (1.3, (0.5, 0.41), (0.08, 3.1)),
)


def vacuum(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a vacuum cleaner that sees where three beacons are.

    The first beacon is at ``y_a``, and the robot moves by ``carpet`` of its commands. From
    ``halt`` on it is told to stand for 20 s.
    """
    first, carpet, halt = (_BEACONS[0][0], physics['y_a']), physics['carpet'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return (
            v * math.cos(psi), v * math.sin(psi), (carpet * u[0] - v) / 0.3, turn,
            (u[1] - turn) / 0.3,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 20.0:
            return 0.0, 0.0
        return 0.25 + 0.12 * square(t, 6.2), 0.15 + 0.7 * square(t, 8.3) + 0.3 * math.sin(1.1 * t)

    def wheels(x: Array) -> list[Array]:
        return [(x[2] + side * 0.23 * x[4]) / 0.035 for side in (-0.5, 0.5)]

    def look(x: Array) -> list[Array]:
        return [
            np.angle(np.exp(1j * (np.arctan2(b - x[1], a - x[0]) - x[3])))
            for a, b in (first, *_BEACONS[1:])
        ]

    start = rng.normal([0.5, 0.2, 0.2, 0.4, 0.3], [0.05, 0.05, 0.03, 0.03, 0.05])
    bias = rng.normal(0.0, 0.02)
    density = [0, 0, 0.004, 0, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)
    return {
        'wheels': sampled(truth, 'wheels', 'two_wheels', 20.0, wheels, [0.6, 0.6], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'beacons': sampled(truth, 'beacons', 'three_bearings', 5.0, look, [0.02] * 3, rng),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def picker(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot that moves in all directions of a warehouse.

    Its scanner, which locates it in a map, is ``ahead`` of its centre, and ``lag`` is that behind
    commands.
    """
    ahead, k = physics['ahead'], 1.0 / physics['lag']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, turn, ax, ay = x
        c, s, growth, fall = math.cos(yaw), math.sin(yaw), ax + turn * vy, ay - turn * vx
        return (
            c * vx - s * vy, s * vx + c * vy, turn, growth, fall, k * (u[2] - turn),
            4.0 * k * (k * (u[0] - vx) - growth), 4.0 * k * (k * (u[1] - vy) - fall),
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return (
            0.9 * square(t + 0.7, 7.1) + 0.4 * math.sin(0.6 * t),
            0.6 * square(t, 5.3) + 0.4 * math.cos(0.9 * t),
            0.6 * square(t + 1.5, 8.9) + 0.4 * math.sin(1.2 * t),
        )

    def scan(x: Array) -> list[Array | float]:
        return [x[0] + ahead * np.cos(x[2]), x[1] + ahead * np.sin(x[2]), x[2], 0.03**2]

    start = rng.normal([10.0, -4.0, 1.1, *[0.0] * 5], [0.05, 0.05, 0.02, *[0.1] * 5])
    density = [0, 0, 0, 0, 0, 0.02, 0.3, 0.3]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)
    return {
        'odom': sampled(
            truth, 'odom', 'legs', 20.0, lambda x: [*x[3:6]], [0.04, 0.04, 0.05], rng
        ),
        'imu': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], x[6], x[7], GRAVITY],
            [0.01] * 3 + [0.15] * 3, rng,
        ),
        'scanner': sampled(
            truth, 'pose', 'place_and_yaw', 5.0, scan, [0.03, 0.03, 0.003, 0], rng
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def skidder(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a machine that drags logs over slopes, with GNSS on a mast.

    Its antenna is ``antenna`` ahead of its middle, and 2.8 m above.
    """
    step, count = 0.005, round(physics['seconds'] / 0.005)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    density = np.array([0.02, 3e-4, 1e-3, 1e-6, 1e-6, 2e-3, 5e-5, 5e-6, 5e-6])
    pushes = rng.standard_normal((count, 9)) * np.sqrt(step * density)
    p = rng.normal([20.0, -30.0, 5.0], 0.05)
    q: Quaternion = product(
        exponential((0.0, 0.0, rng.normal(1.9, 0.05))),
        exponential([*rng.normal([0.05, -0.08], 0.02), 0.0]),
    )
    v, w, a = (
        rng.normal(m, s) for m, s in (([1.5, 0, 0], 0.05), ([0, 0, 0], 0.003), ([0] * 3, 0.02))
    )
    states = list[list[float]]()
    for k in range(count + 1):
        up = np.array(rotated((q[0], -q[1], -q[2], -q[3]), (0.0, 0.0, GRAVITY)))
        nose = rotated(q, (1.0, 0.0, 0.0))
        mast = p + rotated(q, (physics['antenna'], 0.0, 2.8))
        states.append([*mast, math.atan2(nose[1], nose[0]), *v, *w, *(a + up)])
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
        'gnss': sampled(truth, 'place', 'triple', 5.0, lambda x: [*x[:3]], [0.05, 0.05, 0.1], rng),
        'imu': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [*x[7:13]], [0.01] * 3 + [0.1] * 3, rng
        ),
        'tracks': sampled(truth, 'tracks', 'speed', 20.0, column(4), [0.06], rng),
        'heading': sampled(truth, 'heading', 'compass', 5.0, column(3), [0.03], rng),
    }  # fmt: skip


def _averaged(sensed: Array) -> Array:
    """Return means over 10 ms of what is sensed every 2.5 ms, by the rule of trapezia."""
    count = len(sensed) - 1
    parts = [sensed[k : count - 3 + k : 4] for k in range(5)]
    means: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    return means


def backpack(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a surveyor's backpack on a building site with four radio anchors.

    The readings of its IMU are the input, and means over 10 ms. The last anchor is at ``x_d``.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)

    def turn(t: float) -> list[float]:
        return [
            0.25 * math.sin(3.1 * t) + 0.04 * math.cos(0.5 * t),
            0.2 * math.cos(2.7 * t) - 0.05 * math.sin(0.4 * t),
            0.6 * math.cos(0.33 * t) + 0.35 * math.sin(0.8 * t),
        ]

    q: Quaternion = exponential(rng.normal([0.0, 0.05, -0.5], 0.03).tolist())
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
    seen = [
        np.array([rotated((a, -b, -c, -d), v) for (a, b, c, d), v in zip(turns, vectors)])
        for vectors in (moved.tolist(), [_FIELD] * len(turns))
    ]
    states = np.hstack((place, *seen))
    anchors = np.array([*_ANCHORS[:3], (physics['x_d'], *_ANCHORS[3][1:])])

    def far(x: Array) -> list[Array]:
        return [np.sqrt(((x[:3].T - anchor) ** 2).sum(axis=1)) for anchor in anchors]

    imu = _averaged(np.hstack((rates, forces)))
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * np.repeat([1e-9, 1e-7], 3))
    walk[0] = rng.normal(0.0, np.repeat([0.005, 0.05], 3))
    truth = Track(time, states, time[:-4:4], imu + np.cumsum(walk, axis=0))
    heard = commanded(truth, 'imu', 'imu')
    heard.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([2e-5, 2e-3], 3) / 0.01)
    return {
        'anchors': sampled(truth, 'anchors', 'ranges', 10.0, far, [0.08] * 4, rng),
        'stereo': sampled(truth, 'stereo', 'velocity', 10.0, lambda x: [*x[3:6]], [0.05] * 3, rng),
        'magnetometer': sampled(
            truth, 'field', 'field', 10.0, lambda x: [*x[6:9]], [8e-7] * 3, rng
        ),
        'input': heard,
    }


def barge(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a long barge on a lake, with a receiver at the bow and one astern.

    The first antenna is ``bow`` ahead of the middle, and the other one 20 m behind.
    """
    bow = physics['bow']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, turn = x
        return v * math.cos(psi), v * math.sin(psi), 0.0, turn, 0.0

    start = rng.normal([-60.0, 90.0, 3.0, -0.7, 0.0], [1.0, 1.0, 0.1, 0.03, 0.003])
    truth = integrate(rates, start, [0, 0, 0.003, 0, 3e-6], physics['seconds'], 0.02, rng)

    def at(ahead: float, name: str) -> Readings:
        def antenna(x: Array) -> list[Array | float]:
            return [x[0] + ahead * np.cos(x[3]), x[1] + ahead * np.sin(x[3]), 0.6**2]

        return {
            name: sampled(truth, name, 'fix_with_covariance', 2.0, antenna, [0.6, 0.6, 0], rng)
        }

    return {
        **at(bow, 'bow'),
        **at(-20.0, 'stern'),
        'log': sampled(truth, 'log', 'speed', 5.0, column(2), [0.1], rng),
        'rate': sampled(
            truth, 'rate', 'imu', 5.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY],
            [0.003] * 3 + [0.05] * 3, rng,
        ),
    }  # fmt: skip
