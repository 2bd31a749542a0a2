# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a shuttle, a tractor, a robot on mecanum wheels, an aeroplane and an AUV.

Their inputs follow schedules, or what a pilot sees with errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def distance(px: float, py: float) -> Callable[[Array], list[Array]]:
    """Return the reading of the distance of the first two states from a point."""
    return lambda x: [np.hypot(x[0] - px, x[1] - py)]


def shuttle(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a shuttle in the aisles of a hall, with radio ranges.

    ``anchor`` is the true x of the third anchor.
    """
    anchors = {'a': (0.0, 0.0), 'b': (20.0, 1.0), 'c': (physics['anchor'], 13.0)}

    def rates(x: Vector, u: Vector) -> Vector:
        v, psi, omega = x[2:]
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.3, omega, (u[1] - omega) / 0.3
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if math.fmod(t, 18.0) < 2.0:
            return 0.0, 0.0  # loads
        return (0.5, 0.45 * square(t, 72.0)) if math.fmod(t, 9.0) > 5.5 else (1.2, 0.0)

    start = rng.normal([10.0, 6.0, 0.0, 0.4, 0.0], [0.2, 0.2, 0.05, 0.1, 0.05])
    density = [0, 0, 0.02, 0, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.1)
    return {
        'wheels': sampled(
            truth, 'odom', 'odometry', 25.0, lambda x: [x[2], x[4]], [0.02, 0.04], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY], [0.01] * 6, rng
        ),
        **{
            f'anchor_{name}': sampled(
                truth, f'range_{name}', 'range', 5.0, distance(*place), [0.08], rng
            )
            for name, place in anchors.items()
        },
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }


def tractor(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a tractor that works in rows and turns at their ends, with an implement.

    The hitch is 0.9 m behind the rear axle, and the antenna 1 m ahead of it; ``implement`` is the
    distance from the hitch to the axle behind.
    """
    base, length, left = physics['wheelbase'], physics['implement'], physics['antenna_left']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, hitch, v, steering = x
        omega = v * math.tan(steering) / base
        behind = (v * math.sin(hitch) - 0.9 * omega * math.cos(hitch)) / length
        return (
            v * math.cos(psi), v * math.sin(psi), omega, omega - behind,
            (u[0] - v) / 1.0, (u[1] - steering) / 0.4,
        )  # fmt: skip

    def work(t: float, x: Vector) -> Vector:
        if math.fmod(t, 26.0) > 16.0:
            return 1.3, 0.45 * square(t, 52.0)
        return 2.6, 0.04 * math.sin(0.7 * t)

    def antenna(x: Array) -> list[Array]:
        c, s = np.cos(x[2]), np.sin(x[2])
        return [x[0] + c - left * s, x[1] + s + left * c]

    start = rng.normal([0, 0, 0.3, 0, 2, 0], [0.2, 0.2, 0.05, 0.03, 0.2, 0.02])
    density = [0, 0, 0, 1e-5, 0.01, 0.0005]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, work, 0.1)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, antenna, [0.1, 0.1], rng),
        'speed': sampled(truth, 'radar', 'speed', 10.0, column(4), [0.04], rng),
        'steering': sampled(truth, 'steering', 'steering', 20.0, column(5), [0.01], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 40.0,
            lambda x: [0, 0, x[4] * np.tan(x[5]) / base, 0, 0, GRAVITY], [0.008] * 6, rng,
        ),
        'hitch': sampled(truth, 'hitch', 'hitch', 10.0, column(3), [0.01], rng),
        'input': commanded(truth, 'drive', 'drive'),
    }  # fmt: skip


def mecanum(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a robot on four mecanum wheels that a camera locates by tags.

    Its velocity follows commands after a mean delay of 0.3 s; wheels have a radius of 0.05 m.
    """

    def rates(x: Vector, u: Vector) -> Vector:
        yaw, vx, vy, w, ax, ay = x[2:]
        c, s = math.cos(yaw), math.sin(yaw)
        along, across = ax + w * vy, ay - w * vx
        return (
            c * vx - s * vy, s * vx + c * vy, w, along, across, (u[2] - w) / 0.3,
            (u[0] - vx) * 4.0 / 0.09 - along * 4.0 / 0.3,
            (u[1] - vy) * 4.0 / 0.09 - across * 4.0 / 0.3,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if math.fmod(t, 24.0) > 20.0:
            return 0.0, 0.0, 0.0  # loads
        return 0.5 * square(t, 16.0), 0.3 * square(t + 5.0, 20.0), 0.4 * math.sin(0.5 * t)

    def wheels(x: Array) -> list[Array]:
        signs = (-1, -1), (1, 1), (1, -1), (-1, 1)
        return [(x[3] + side * x[4] + turn * 0.35 * x[5]) / 0.05 for side, turn in signs]

    start = rng.normal([3.0, 2.0, 1.0, 0, 0, 0, 0, 0], [0.1, 0.1, 0.05] + [0.1] * 5)
    density = [0, 0, 0, 0, 0, 0.01, 0.1, 0.1]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.1)
    return {
        'wheels': sampled(truth, 'wheels', 'mecanum', 25.0, wheels, [0.4] * 4, rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[5], 0, 0, GRAVITY], [0.01] * 6, rng
        ),
        'tags': sampled(
            truth, 'tags', 'place_and_yaw', 5.0, lambda x: [x[0], x[1], x[2], 0.03**2],
            [0.03, 0.03, 0.003, 0], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'walk'),
    }  # fmt: skip


def aeroplane(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a small aeroplane that flies turns in a wind, which changes slowly."""

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, speed, bank, east, north = x
        return (
            speed * math.cos(psi) + east, speed * math.sin(psi) + north,
            GRAVITY * math.tan(bank) / speed, (u[0] - speed) / 4.0, (u[1] - bank) / 0.6, 0.0, 0.0,
        )  # fmt: skip

    def fly(t: float, x: Vector) -> Vector:
        return 18.0 + 2.5 * square(t, 44.0), 0.25 * square(t + 6.0, 50.0) + 0.2 * math.sin(0.4 * t)

    start = rng.normal([0, 0, 1, 18, 0, 3, -2], [2, 2, 0.1, 1, 0.05, 1, 1])
    density = [0, 0, 1e-5, 0.05, 0.001, 0.01, 0.01]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, fly, 0.2)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 4.0, lambda x: [x[0], x[1]], [1.0, 1.0], rng),
        'pitot': sampled(
            truth, 'pitot', 'pressure', 10.0, lambda x: [0.6 * x[3] ** 2], [6.0], rng
        ),
        'ahrs': sampled(
            truth, 'ahrs', 'attitude', 20.0, lambda x: [x[4], 0, x[2]], [0.02, 0, 0.03], rng
        ),
        'input': commanded(truth, 'autopilot', 'speed_and_bank'),
    }


def auv(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a hundred seconds of an AUV in a vertical plane, that passes below a beacon.

    ``nose`` is how far the depth gauge is ahead of the centre, and ``aft`` the gain of the aft
    thruster.
    """
    buoyancy, drag, nose, gain = (physics[k] for k in ('buoyancy', 'drag', 'nose', 'aft'))

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, pitch, ahead, up, q = x
        c, s = math.cos(pitch), math.sin(pitch)
        fore, aft = u[1], gain * u[2]
        surge = u[0] - (8.0 + drag * abs(ahead)) * ahead - buoyancy * s - 55.0 * up * q
        heave = fore + aft - (8.0 + drag * abs(up)) * up + buoyancy * c + 35.0 * ahead * q
        moment = 0.4 * (aft - fore) - (1.0 + 4.0 * abs(q)) * q - 40.0 * s + 20.0 * ahead * up
        return (
            c * ahead + s * up, c * up - s * ahead, q, surge / 35.0, heave / 55.0, moment / 4.0
        )  # fmt: skip

    def dive(t: float, x: Vector) -> Vector:
        depth = 9.0 + 2.5 * square(t, 46.0)
        heave = (
            -6.0 * (depth + x[1] + rng.normal(0.0, 0.3))
            - 30.0 * (x[4] + rng.normal(0.0, 0.1))
            - 5.0
        )
        moment = 5.0 * square(t + 3.0, 17.0) + 3.0 * math.sin(0.9 * t)
        heave = max(-20.0, min(10.0, heave))
        aft = 0.5 * heave + 0.5 * moment / 0.4
        return 20.0 + 10.0 * square(t, 26.0), heave - aft, aft

    start = rng.normal([0, -9, 0, 0.4, 0, 0], [0.3, 0.2, 0.03, 0.1, 0.05, 0.03])
    density = [0, 0, 0, 0.5 / 35.0**2, 0.5 / 55.0**2, 0.01 / 16.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, dive, 0.2)
    return {
        'dvl': sampled(
            truth, 'dvl', 'surge_and_heave', 5.0, lambda x: [x[3], x[4]], [0.015, 0.015], rng
        ),
        'depth': sampled(
            truth, 'depth', 'pressure', 10.0,
            lambda x: [101325.0 - 1025.0 * GRAVITY * (x[1] - nose * np.sin(x[2]))], [300.0], rng,
        ),
        'beacon': sampled(truth, 'beacon', 'range', 1.0, distance(45.0, -1.0), [0.3], rng),
        'attitude': sampled(
            truth, 'attitude', 'attitude', 10.0, lambda x: [0, x[2], 0], [0, 0.02, 0], rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 25.0, lambda x: [0, x[5], 0, 0, 0, 0], [0.01] * 6, rng
        ),
        'input': commanded(truth, 'thrusters', 'auv_thrusters'),
    }  # fmt: skip
