# SPDX-License-Identifier: Apache-2.0
"""Vehicles and targets: a courier robot, a racing car, a scout drone, an aircraft, a radio tag.

Inputs are programs of time; the courier, the aircraft and the person with the tag have none.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def courier(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a delivery robot on pavements, whose gyro has an unknown bias.

    ``antenna_left`` is the place of the antenna, which is 0.2 m ahead of the axle.
    """
    left = physics['antenna_left']

    def rates(x: Vector, u: Vector) -> Vector:
        return x[3] * math.cos(x[2]), x[3] * math.sin(x[2]), x[4], 0.0, 0.0

    def antenna(x: Array) -> list[Array | float]:
        c, s = np.cos(x[2]), np.sin(x[2])
        return [x[0] + 0.2 * c - left * s, x[1] + 0.2 * s + left * c, 0.3**2]

    start = rng.normal([2.0, -1.0, 0.7, 1.2, 0.1], [0.3, 0.3, 0.1, 0.2, 0.05])
    bias = rng.normal(0.0, 0.02)
    truth = integrate(rates, start, [0, 0, 0, 0.008, 0.004], physics['seconds'], 0.01, rng)

    def wheels(x: Array) -> list[Array]:
        return [(x[3] - 0.24 * x[4]) / 0.1, (x[3] + 0.24 * x[4]) / 0.1]

    return {
        'wheels': sampled(truth, 'wheels', 'two_wheels', 20.0, wheels, [0.3, 0.3], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4] + bias, 0, 0, GRAVITY],
            [0.008] * 3 + [0.05] * 3, rng,
        ),
        'gnss': sampled(truth, 'fix', 'fix_with_covariance', 5.0, antenna, [0.3, 0.3, 0], rng),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(2), [0.05], rng),
    }  # fmt: skip


def racer(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a model car that drifts through curves and is located by a lidar.

    Its tyres are linear, of ``stiffness`` at each axle; ``reach`` is the angle of the wheels by
    that of the command.
    """
    tyre, reach = physics['stiffness'], physics['reach']

    def forces(x: Vector | Array) -> tuple[Array | float, Array | float]:
        v, vy, r, steering = x[3], x[4], x[5], x[6]
        return tyre * (steering - (vy + 0.16 * r) / v), -tyre * (vy - 0.16 * r) / v

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, vy, r, steering = x
        front, rear = forces(x)
        c, s = math.cos(psi), math.sin(psi)
        return (
            v * c - vy * s, v * s + vy * c, r, (u[0] - v) / 0.4, float(front + rear) / 3.5 - v * r,
            0.16 * float(front - rear) / 0.06, (reach * u[1] - steering) / 0.12,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return 2.6 + 0.5 * square(t + 1.0, 7.0), 0.14 * square(t, 6.4) + 0.1 * math.sin(1.3 * t)

    def imu(x: Array) -> list[Array | float]:
        front, rear = forces(x)
        return [0, 0, x[5], 0, (front + rear) / 3.5, GRAVITY]

    start = rng.normal([5, 4, 0.3, 2.5, 0, 0, 0], [0.1, 0.1, 0.05, 0.2, 0.05, 0.1, 0.02])
    density = [0, 0, 0, 0.05, 0.01, 0.05, 0.0005]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.04)
    return {
        'lidar': sampled(
            truth, 'amcl', 'place_and_yaw', 10.0, lambda x: [x[0], x[1], x[2], 0.04**2],
            [0.04, 0.04, 0.004, 0], rng,
        ),
        'wheel': sampled(truth, 'wheel', 'wheel', 25.0, lambda x: [x[3] / 0.05], [1.0], rng),
        'imu': sampled(truth, 'imu', 'imu', 50.0, imu, [0.02] * 3 + [0.25] * 3, rng),
        'input': commanded(truth, 'drive', 'drive'),
    }  # fmt: skip


def scout(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a drone indoors, with a camera that looks down and a range finder.

    Its autopilot follows commands of attitude and climb.
    """
    drag = physics['drag']

    def rates(x: Vector, u: Vector) -> Vector:
        roll, pitch, vx, vy, _, climb = x
        return (
            (u[0] - roll) / 0.25, (u[1] - pitch) / 0.25, GRAVITY * math.tan(pitch) - drag * vx,
            -GRAVITY * math.tan(roll) - drag * vy, climb, (u[2] - climb) / 0.6,
        )  # fmt: skip

    def fly(t: float, x: Vector) -> Vector:
        return (
            0.12 * square(t, 7.0) + 0.05 * math.sin(1.9 * t),
            0.12 * square(t + 2.0, 9.0) + 0.05 * math.sin(1.4 * t),
            0.35 * square(t, 11.0),
        )

    start = rng.normal([0, 0, 0, 0, 3.5, 0], [0.03, 0.03, 0.2, 0.2, 0.1, 0.1])
    density = [0.0004, 0.0004, 0.03, 0.03, 0, 0.01]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, fly, 0.05)
    return {
        'flow': sampled(
            truth, 'flow', 'flow', 20.0, lambda x: [x[2] / x[4], x[3] / x[4]], [0.03, 0.03], rng
        ),
        'range': sampled(
            truth, 'range', 'range', 20.0, lambda x: [x[4] / np.cos(x[0]) / np.cos(x[1])],
            [0.03], rng,
        ),
        'attitude': sampled(
            truth, 'attitude', 'attitude', 50.0, lambda x: [x[0], x[1], 0], [0.01, 0.01, 0], rng
        ),
        'input': commanded(truth, 'setpoint', 'roll_pitch_climb'),
    }  # fmt: skip


def target(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of an aircraft before a radar, a camera on a mast and its own transponder."""

    def rates(x: Vector, u: Vector) -> Vector:
        return x[2] * math.cos(x[3]), x[2] * math.sin(x[3]), 0.0, x[4], 0.0

    start = rng.normal([9e3, 5e3, 90.0, 2.4, 0.0], [50.0, 50.0, 5.0, 0.05, 0.005])
    truth = integrate(rates, start, [0, 0, 0.5, 0, 8e-6], physics['seconds'], 0.02, rng)

    def radar(x: Array) -> list[Array]:
        distance = np.hypot(x[0], x[1])
        closing = x[2] * (x[0] * np.cos(x[3]) + x[1] * np.sin(x[3])) / distance
        return [distance, np.arctan2(x[1], x[0]), closing]

    return {
        'radar': sampled(truth, 'radar', 'triple', 1.0, radar, [30.0, 0.003, 1.5], rng),
        'mast': sampled(
            truth, 'mast', 'point', 5.0, lambda x: [np.arctan2(x[1] + 2e3, x[0] - 6e3)],
            [0.002], rng,
        ),
        'transponder': sampled(
            truth, 'transponder', 'point', 1.0, lambda x: [x[0], x[1]], [15.0, 15.0], rng
        ),
    }  # fmt: skip


def tag(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a person in a hall, with a radio tag, below a camera.

    Four anchors measure distances; ``anchor`` is the true x of the third one.
    """
    anchors = (0.0, 0.0), (40.0, 0.0), (physics['anchor'], 30.0), (0.0, 30.0)
    start = rng.normal([20.0, 14.0, 0.5, -0.3], [0.3, 0.3, 0.3, 0.3])
    truth = integrate(
        lambda x, u: (x[2], x[3], -0.25 * x[2], -0.25 * x[3]), start, [0, 0, 0.15, 0.15],
        physics['seconds'], 0.01, rng,
    )  # fmt: skip

    def ranges(x: Array) -> list[Array]:
        return [np.hypot(x[0] - px, x[1] - py) for px, py in anchors]

    return {
        'uwb': sampled(truth, 'uwb', 'ranges', 10.0, ranges, [0.1] * 4, rng),
        'camera': sampled(truth, 'camera', 'point', 4.0, lambda x: [x[0], x[1]], [0.1, 0.1], rng),
    }
