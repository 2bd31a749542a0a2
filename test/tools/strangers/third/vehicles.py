# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a forklift, a hovercraft, a glider, a walking robot and an underwater vehicle.

Their inputs follow schedules, or what a pilot sees with errors.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def forklift(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a hundred seconds of a forklift in a hall that a laser scanner knows.

    Its rear wheel drives and steers. The scanner may be ahead of the front axle.
    """
    base, radius, forward = physics['wheelbase'], physics['radius'], physics['scanner']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, steering = x
        return (
            v * math.cos(psi), v * math.sin(psi), -v * math.tan(steering) / base,
            (u[0] - v) / 0.6, (u[1] - steering) / 0.3,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        wheel = 0.5 * math.sin(0.4 * t) + 0.35 * square(t + 4.0, 19.0)
        return 0.4 + 1.0 * square(t, 22.0) + 0.3 * math.sin(0.7 * t), wheel

    def scanner(x: Array) -> list[Array | float]:
        return [x[0] + forward * np.cos(x[2]), x[1] + forward * np.sin(x[2]), x[2], 0.03**2]

    start = rng.normal([3.0, 8.0, 0.5, 0.0, 0.0], [0.1, 0.1, 0.05, 0.1, 0.03])
    density = [0, 0, 0, 0.02, 0.001]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.1)
    return {
        'scanner': sampled(
            truth, 'localisation', 'place_and_yaw', 8.0, scanner, [0.03, 0.03, 0.003, 0], rng
        ),
        'wheel': sampled(
            truth, 'traction', 'wheel', 25.0,
            lambda x: [x[3] / np.cos(x[4]) / radius], [0.15], rng,
        ),
        'steering': sampled(truth, 'steering', 'steering', 25.0, column(4), [0.01], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0,
            lambda x: [0, 0, -x[3] * np.tan(x[4]) / base, 0, 0, GRAVITY],
            [0.01] * 3 + [0.1] * 3, rng,
        ),
        'input': commanded(truth, 'drive', 'drive'),
    }  # fmt: skip


def hovercraft(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a hundred seconds of a hovercraft on a pond.

    The antenna may be ahead of its centre. After 40 s, something pushes it to the left for a
    second, with the acceleration ``shove``.
    """
    drag, forward, shove = physics['drag'], physics['antenna'], physics['shove']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, ahead, left, r = x
        c, s = math.cos(psi), math.sin(psi)
        return (
            c * ahead - s * left, s * ahead + c * left, r,
            u[0] / 12.0 - drag / 12.0 * ahead + r * left, u[2] - drag / 12.0 * left - r * ahead,
            (u[1] - 1.2 * r) / 1.5,
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        turn = 0.35 * square(t, 21.0) + 0.45 * math.sin(0.5 * t)
        return 5.0 + 2.5 * square(t + 3.0, 16.0), turn, shove * (40.0 <= t < 41.0)

    def antenna(x: Array) -> list[Array]:
        return [x[0] + forward * np.cos(x[2]), x[1] + forward * np.sin(x[2])]

    def field(x: Array) -> list[Array | float]:
        return [2e-5 * np.sin(x[2]), 2e-5 * np.cos(x[2]), -4.3e-5]

    start = rng.normal([0.0, 0.0, 1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.1, 0.3, 0.3, 0.1])
    density = [0, 0, 0, 0.01, 0.01, 0.003]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, steer, 0.1)
    truth.command = truth.command[:, :2]  # nobody records the shove
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, antenna, [0.5, 0.5], rng),
        'magnetometer': sampled(truth, 'field', 'field', 20.0, field, [6e-7] * 3, rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 40.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY],
            [0.02] * 3 + [0.1] * 3, rng,
        ),
        'flow': sampled(
            truth, 'flow', 'velocity', 10.0, lambda x: [x[3], x[4], 0], [0.1, 0.1, 0], rng
        ),
        'input': commanded(truth, 'fan', 'push_and_turn'),
    }  # fmt: skip


def glider(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a glider that dives and climbs in one vertical plane."""
    drag = physics['drag']

    def rates(x: Vector, u: Vector) -> Vector:
        _, speed, path = x
        return (
            speed * math.sin(path),
            -GRAVITY * math.sin(path) - 0.018 * (drag + 0.03 * u[0] ** 2) * speed**2,
            0.018 * u[0] * speed - GRAVITY * math.cos(path) / speed,
        )

    def fly(t: float, x: Vector) -> Vector:
        level = x[2] + rng.normal(0.0, 0.03)
        wish = 0.06 * square(t, 18.0) + 0.05 * math.sin(0.8 * t) - 0.05
        return (min(1.3, max(0.2, 0.75 + 1.0 * (wish - level))),)

    def static(x: Array) -> list[Array]:
        return [101325.0 * (1.0 - 0.0065 / 288.15 * (x[0] + 500.0)) ** 5.255876]

    start = rng.normal([600.0, 27.0, 0.0], [3.0, 1.0, 0.03])
    truth = integrate(rates, start, [0.02, 0.02, 5e-5], physics['seconds'], 0.005, rng, fly, 0.1)
    return {
        'static': sampled(truth, 'static', 'pressure', 10.0, static, [8.0], rng),
        'pitot': sampled(
            truth, 'pitot', 'pressure', 20.0, lambda x: [0.6 * x[1] ** 2], [8.0], rng
        ),
        'vario': sampled(
            truth, 'vario', 'climb', 10.0, lambda x: [x[1] * np.sin(x[2])], [0.2], rng
        ),
        'gnss': sampled(truth, 'fix', 'altitude', 4.0, column(0), [1.5], rng),
        'input': commanded(truth, 'lift', 'force'),
    }


def walker(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a hundred seconds of the base of a robot on legs, which also walks sideways.

    Its velocity follows commands after a mean delay of 0.4 s.
    """

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, yaw, vx, vy, w, ax, ay = x
        c, s, k = math.cos(yaw), math.sin(yaw), 2.5
        dx, dy = ax + w * vy, ay - w * vx
        return (
            c * vx - s * vy, s * vx + c * vy, w, dx, dy, k * (u[2] - w),
            4.0 * k * (k * (u[0] - vx) - dx), 4.0 * k * (k * (u[1] - vy) - dy),
        )  # fmt: skip

    def walk(t: float, x: Vector) -> Vector:
        ahead = 0.45 + 0.35 * square(t, 14.0)
        return ahead, 0.25 * math.sin(0.6 * t), 0.3 * square(t + 2.0, 23.0) + 0.3 * math.sin(t)

    start = rng.normal([1.0, 2.0, -0.5, 0, 0, 0, 0, 0], [0.1, 0.1, 0.05] + [0.1] * 5)
    density = [0, 0, 0, 0, 0, 0.02, 0.2, 0.2]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, walk, 0.1)
    return {
        'legs': sampled(
            truth, 'odom', 'legs', 25.0, lambda x: [x[3], x[4], x[5]], [0.05, 0.05, 0.06], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY],
            [0.015] * 3 + [0.3] * 3, rng,
        ),
        'vision': sampled(
            truth, 'vision', 'place_and_yaw', 4.0, lambda x: [x[0], x[1], x[2], 0.04**2],
            [0.04, 0.04, 0.004, 0], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def rov(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of an underwater vehicle that surveys between 8 and 20 m of depth.

    ``astern`` is the share of the surge that its thrusters have backwards.
    """
    mass, drag, astern = physics['mass'], physics['drag'], physics['astern']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, _, psi, ahead, up, r = x
        surge = u[0] * (astern if u[0] < 0.0 else 1.0)
        return (
            ahead * math.cos(psi), ahead * math.sin(psi), up, r,
            (surge - drag * ahead * abs(ahead)) / mass,
            (u[1] - 120.0 * up * abs(up)) / mass, (u[2] - 12.0 * r * abs(r)) / 8.0,
        )  # fmt: skip

    def survey(t: float, x: Vector) -> Vector:
        depth = 14.0 + 4.0 * square(t, 50.0)
        heave = -12.0 * (depth + x[2] + rng.normal(0.0, 0.1))
        yaw = 1.2 * square(t, 24.0) + 0.8 * math.sin(0.4 * t)
        surge = 15.0 + 35.0 * square(t + 5.0, 20.0)
        return surge, min(40.0, max(-40.0, heave)), yaw

    start = rng.normal([0, 0, -10.0, 0.5, 0, 0, 0], [0.5, 0.5, 0.1, 0.05, 0.1, 0.05, 0.05])
    density = [0, 0, 0, 0, 0.001, 0.0005, 0.001]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, survey, 0.2)
    return {
        'dvl': sampled(
            truth, 'dvl', 'velocity', 5.0, lambda x: [x[4], 0, x[5]], [0.02, 0.02, 0.02], rng
        ),
        'usbl': sampled(truth, 'usbl', 'point', 1.0, lambda x: [x[0], x[1]], [0.3, 0.3], rng),
        'depth': sampled(
            truth, 'depth', 'pressure', 10.0,
            lambda x: [101325.0 - 1025.0 * GRAVITY * x[2]], [400.0], rng,
        ),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(3), [0.03], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 20.0, lambda x: [0, 0, x[6], 0, 0, GRAVITY],
            [0.01] * 3 + [0.1] * 3, rng,
        ),
        'input': commanded(truth, 'thrusters', 'thrusters'),
    }  # fmt: skip
