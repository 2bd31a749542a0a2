# SPDX-License-Identifier: Apache-2.0
"""Vehicles and an animal: a weeding robot, a rail trolley, a yacht, a parafoil and a horse.

Inputs are programs of time; the horse has none.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def weeder(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a weeding robot, whose GNSS receives corrections.

    ``antenna`` is how far the antenna is ahead of the axle. From ``halt`` on the robot is told to
    stand still for 12 s.
    """
    ahead, halt = physics['antenna'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, turn = x
        return v * math.cos(psi), v * math.sin(psi), turn, (u[0] - v) / 0.3, (u[1] - turn) / 0.3

    def drive(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 12.0:
            return 0.0, 0.0
        return 0.6 + 0.25 * square(t, 11.0), 0.5 * square(t, 8.0) + 0.2 * math.sin(0.7 * t)

    start = rng.normal([4.0, 3.0, 0.5, 0.5, 0.0], [0.1, 0.1, 0.05, 0.1, 0.05])
    density = [0, 0, 0, 0.01, 0.01]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, drive, 0.1)
    return {
        'wheels': sampled(
            truth, 'wheels', 'two_wheels', 20.0,
            lambda x: [(x[3] - 0.25 * x[4]) / 0.12, (x[3] + 0.25 * x[4]) / 0.12], [0.2, 0.2], rng,
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY],
            [0.01] * 3 + [0.05] * 3, rng,
        ),
        'gnss': sampled(
            truth, 'fix', 'fix', 5.0,
            lambda x: [x[0] + ahead * np.cos(x[2]), x[1] + ahead * np.sin(x[2])],
            [0.04, 0.04], rng,
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def trolley(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a trolley that inspects rails and is pushed by a motor.

    ``mass`` is its own, and ``friction`` in N s/m.
    """
    mass, friction = physics['mass'], physics['friction']

    def push(t: float, x: Vector) -> Vector:
        return (8.0 + 24.0 * square(t, 13.0) + 8.0 * math.sin(1.1 * t),)

    start = rng.normal([20.0, 0.5], [0.1, 0.2])
    truth = integrate(
        lambda x, u: (x[1], (u[0] - friction * x[1]) / mass), start, [0, 0.01],
        physics['seconds'], 0.01, rng, push, 0.05,
    )  # fmt: skip
    return {
        'odometer': sampled(truth, 'odometer', 'angle', 20.0, lambda x: [x[0] / 0.1], [0.3], rng),
        'doppler': sampled(truth, 'doppler', 'speed', 10.0, column(1), [0.05], rng),
        'laser': sampled(truth, 'laser', 'range', 4.0, column(0), [0.03], rng),
        'input': commanded(truth, 'push', 'force'),
    }


def yacht(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return three minutes of a sailing yacht, whose sails' forces are measured at the rig.

    ``leeway`` is the velocity to the side by the acceleration to it, ``masthead`` how far the
    antenna is ahead of the centre, and ``drag`` the decay of the speed.
    """
    leeway, drag, masthead = physics['leeway'], physics['drag'], physics['masthead']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, turn, speed, side = x
        c, s = math.cos(psi), math.sin(psi)
        return (
            speed * c - side * s, speed * s + side * c, turn, (0.5 * speed * u[2] - turn) / 1.2,
            u[0] - drag * speed, (leeway * u[1] - side) / 2.0,
        )  # fmt: skip

    def sail(t: float, x: Vector) -> Vector:
        return (
            0.6 + 0.25 * square(t, 17.0),
            0.5 * square(t + 3.0, 26.0),
            0.15 * square(t, 13.0) + 0.1 * math.sin(0.8 * t),
        )

    def antenna(x: Array) -> list[Array]:
        return [x[0] + masthead * np.cos(x[2]), x[1] + masthead * np.sin(x[2])]

    start = rng.normal([0, 0, 1.2, 0, 2.5, 0], [1.0, 1.0, 0.05, 0.05, 0.2, 0.2])
    density = [0, 0, 0, 0.001, 0.005, 0.005]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, sail, 0.1)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 4.0, antenna, [0.8, 0.8], rng),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(2), [0.03], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 20.0, lambda x: [0, 0, x[3], 0, 0, GRAVITY],
            [0.01] * 3 + [0.2] * 3, rng,
        ),
        'log': sampled(truth, 'log', 'speed', 5.0, column(4), [0.08], rng),
        'input': commanded(truth, 'helm', 'helm'),
    }  # fmt: skip


def parafoil(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a load below a steered parafoil, in a wind.

    ``airspeed`` and ``response`` are the speed along, and the turn rate by the brake.
    """
    airspeed, response = physics['airspeed'], physics['response']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, _, psi, turn, sink, east, north = x
        return (
            airspeed * math.cos(psi) + east, airspeed * math.sin(psi) + north, -sink, turn,
            (response * u[0] - turn) / 0.8, (4.5 + 1.5 * abs(u[0]) - sink) / 1.5, 0.0, 0.0,
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        return (0.7 * square(t, 14.0) + 0.25 * math.sin(0.9 * t),)

    start = rng.normal([0, 0, 620, 0.8, 0, 5, 3, -2], [2.0, 2.0, 2.0, 0.1, 0.05, 0.3, 1.0, 1.0])
    density = [0, 0, 0, 0, 0.004, 0.02, 0.02, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, steer, 0.1)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, lambda x: [x[0], x[1]], [1.0, 1.0], rng),
        'barometer': sampled(truth, 'height', 'range', 10.0, column(2), [0.6], rng),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(3), [0.04], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 25.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY],
            [0.02] * 3 + [0.3] * 3, rng,
        ),
        'input': commanded(truth, 'brake', 'spin'),
    }  # fmt: skip


def horse(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a horse with a collar, in a field between two masts that range by radio.

    ``mast`` is the true x of the second one.
    """
    start = rng.normal([120.0, 150.0, 1.0, -0.5], [2.0, 2.0, 0.5, 0.5])
    truth = integrate(
        lambda x, u: (x[2], x[3], 0.0, 0.0), start, [0, 0, 0.05, 0.05], physics['seconds'], 0.02,
        rng,
    )  # fmt: skip
    second = physics['mast']
    return {
        'gnss': sampled(
            truth, 'fix', 'fix_with_covariance', 1.0, lambda x: [x[0], x[1], 1.5**2],
            [1.5, 1.5, 0], rng,
        ),
        'velocity': sampled(truth, 'velocity', 'velocity', 5.0, lambda x: [x[2], x[3]],
                            [0.15, 0.15], rng),
        'masts': sampled(
            truth, 'masts', 'point', 2.0,
            lambda x: [np.hypot(x[0], x[1]), np.hypot(x[0] - second, x[1])], [0.7, 0.7], rng,
        ),
    }  # fmt: skip
