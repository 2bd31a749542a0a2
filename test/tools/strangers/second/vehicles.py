# SPDX-License-Identifier: Apache-2.0
"""Vehicles: a ferry, a crawler on tracks, a train, a blimp, a taxi, a copter and a diver.

The pilots see noisy measurements or follow a schedule, and never see the true state.
"""

from __future__ import annotations

import math

import numpy as np

from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square

Physics = dict[str, float]
GRAVITY = 9.80665


def ferry(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a ferry that crosses a tide back and forth.

    Engine and rudder follow a schedule. The antenna may be ahead of the centre.
    """
    gain, forward, seconds = physics['gain'], physics['antenna'], physics['seconds']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, speed, omega, east, north = x
        return (
            speed * math.cos(psi) + east, speed * math.sin(psi) + north, omega,
            (u[0] - speed) / 12.0, (gain * u[1] - omega) / 8.0, 0.0, 0.0,
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        rudder = 0.25 * math.sin(0.045 * t) + 0.15 * square(t + 10.0, 70.0)
        return 4.5 + 1.5 * square(t, 110.0), rudder

    def antenna(x: Array) -> list[Array]:
        return [x[0] + forward * np.cos(x[2]), x[1] + forward * np.sin(x[2])]

    start = rng.normal([0, 0, 0.8, 4.0, 0, 0.3, -0.4], [2, 2, 0.1, 0.5, 0.01, 0.3, 0.3])
    density = [0, 0, 0, 0.002, 1e-5, 1e-5, 1e-5]
    truth = integrate(rates, start, density, seconds, 0.02, rng, steer, 0.2)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 2.0, antenna, [1.0, 1.0], rng),
        'compass': sampled(truth, 'compass', 'compass', 5.0, column(2), [0.02], rng),
        'log': sampled(truth, 'log', 'speed', 4.0, column(3), [0.06], rng),
        'input': commanded(truth, 'helm', 'drive'),
    }


def crawler(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a vehicle on tracks, with a sprocket of 0.15 m on each side.

    The encoders of both tracks are two sensors; the messages of the position, from a
    total station, have a covariance.
    """
    width, radius, left_of = 0.8, 0.15, physics['prism_left']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, omega = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.4, omega, (u[1] - omega) / 0.4
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if math.fmod(t, 55.0) > 45.0:
            return 0.0, 0.4  # turns on the spot
        return 0.5 + 0.4 * math.sin(0.5 * t), 0.35 * square(t, 17.0) + 0.3 * math.sin(0.31 * t)

    def prism(x: Array) -> list[Array | float]:
        return [x[0] - left_of * np.sin(x[3]), x[1] + left_of * np.cos(x[3]), 0.15**2]

    start = rng.normal([5.0, -3.0, 0.0, 2.0, 0.0], [0.2, 0.2, 0.05, 0.1, 0.05])
    density = [0, 0, 0.03, 0, 0.03]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, drive, 0.1)
    return {
        'left': sampled(
            truth, 'left', 'left', 25.0,
            lambda x: [(x[2] - 0.5 * width * x[4]) / radius], [0.2], rng,
        ),
        'right': sampled(
            truth, 'right', 'right', 25.0,
            lambda x: [(x[2] + 0.5 * width * x[4]) / radius], [0.2], rng,
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY],
            [0.02] * 3 + [0.1] * 3, rng,
        ),
        'position': sampled(
            truth, 'position', 'pose_with_covariance', 4.0, prism, [0.15, 0.15, 0], rng
        ),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }  # fmt: skip


def train(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return five minutes of a train that stops, crawls and drives fast on a level line.

    Its driver reads a speedometer of 0.3 m/s.
    """
    mass = physics['mass']
    profile = (22.0, 6.0, 1.4, 28.0, 0.0, 12.0)

    def rates(x: Vector, u: Vector) -> Vector:
        v = x[1]
        return v, (u[0] - 300.0 * v - 6.0 * v * abs(v)) / mass

    def drive(t: float, x: Vector) -> Vector:
        wanted = profile[int(t / 50.0) % len(profile)]
        seen = x[1] + rng.normal(0.0, 0.3)
        return (max(-45000.0, min(45000.0, 20000.0 * (wanted - seen))),)

    start = rng.normal([0.0, 10.0], [5.0, 0.5])
    truth = integrate(rates, start, [0, 0.003], physics['seconds'], 0.02, rng, drive, 0.5)
    return {
        'doppler': sampled(truth, 'doppler', 'speed', 5.0, column(1), [0.08], rng),
        'axle': sampled(truth, 'axle', 'axle', 10.0, lambda x: [x[1] / 0.46], [0.3], rng),
        'gnss': sampled(truth, 'track', 'point', 2.0, column(0), [2.0], rng),
        'input': commanded(truth, 'force', 'force'),
    }


def blimp(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a blimp that drifts in gusts, seen by a radar on the ground.

    Its receiver reports the variance of each fix, which changes in steps if ``cover`` is not 0.
    """
    start = rng.normal([420.0, 310.0, 1.5, -1.0], [5.0, 5.0, 0.5, 0.5])
    density, cover = [0, 0, 0.008, 0.008], physics['cover']

    def radar(x: Array) -> list[Array]:
        distance = np.hypot(x[0], x[1])
        return [distance, np.arctan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / distance]

    truth = integrate(
        lambda x, u: (x[2], x[3], 0, 0), start, density, physics['seconds'], 0.02, rng
    )
    fix = sampled(
        truth, 'fix', 'fix_with_covariance', 1.0, lambda x: [x[0], x[1], 2.25], [1.5, 1.5, 0], rng
    )
    worse = (1.0 + cover * (np.floor(fix.time / 20.0) % 3.0))[:, np.newaxis]
    fix.noise *= worse
    fix.value[:, 2:] *= worse**2
    return {
        'radar': sampled(truth, 'radar', 'triple', 4.0, radar, [1.0, 0.004, 0.1], rng),
        'fix': fix,
    }


def taxi(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a car in town; speed and steering follow the commands of a schedule.

    The place is that of the rear axle; the antenna may be elsewhere. ``spread`` multiplies all
    noise.
    """
    base, forward, spread = physics['wheelbase'], physics['antenna'], physics['spread']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, angle = x
        return (
            v * math.cos(psi), v * math.sin(psi), v * math.tan(angle) / base,
            (u[0] - v) / 2.0, (u[1] - angle) / 0.3,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        wheel = 0.16 * math.sin(0.33 * t) + 0.14 * square(t + 3.0, 13.0)
        return 6.0 + 3.0 * square(t, 24.0), wheel

    def antenna(x: Array) -> list[Array]:
        return [x[0] + forward * np.cos(x[2]), x[1] + forward * np.sin(x[2])]

    def imu(x: Array) -> list[Array | float]:
        turn = x[3] * np.tan(x[4]) / base
        return [0, 0, turn, 0, x[3] * turn, GRAVITY]

    start = rng.normal([0, 0, -1.0, 5.0, 0.0], [1.0, 1.0, 0.1, 1.0, 0.02])
    density = [0, 0, 0, 0.05, 0.0005]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, drive, 0.1)

    def noise(*deviations: float) -> list[float]:
        return [spread * deviation for deviation in deviations]

    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, antenna, noise(0.4, 0.4), rng),
        'speed': sampled(truth, 'speed', 'speed', 10.0, column(3), noise(0.1), rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 40.0, imu, noise(0.01, 0.01, 0.01, 0.2, 0.2, 0.2), rng
        ),
        'steering': sampled(truth, 'steering', 'angle', 20.0, column(4), noise(0.01), rng),
        'input': commanded(truth, 'ackermann', 'drive'),
    }


def copter(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of the height of a multicopter, between 2 and 14 m.

    Its pilot sees height and climb with errors of 0.3 m and 0.2 m/s.
    """
    mass = physics['mass']

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], u[0] / mass - GRAVITY - 0.4 * x[1]

    def fly(t: float, x: Vector) -> Vector:
        z, v = x[0] + rng.normal(0.0, 0.3), x[1] + rng.normal(0.0, 0.2)
        wanted = 8.0 + 4.0 * math.sin(0.21 * t) + 2.0 * square(t, 16.0)
        lift = max(-4.0, min(4.0, 1.2 * (wanted - z) - 1.6 * v))
        return (1.5 * (GRAVITY + lift),)

    def pressure(x: Array) -> list[Array]:
        return [101325.0 * (1.0 - 0.0065 / 288.15 * (x[0] + 400.0)) ** 5.255876]

    start = rng.normal([5.0, 0.0], [0.5, 0.2])
    truth = integrate(rates, start, [0, 0.03], physics['seconds'], 0.005, rng, fly, 0.05)
    return {
        'barometer': sampled(truth, 'pressure', 'pressure', 10.0, pressure, [5.0], rng),
        'gnss': sampled(truth, 'fix', 'altitude', 5.0, column(0), [0.6], rng),
        'laser': sampled(truth, 'laser', 'range', 20.0, column(0), [0.05], rng),
        'input': commanded(truth, 'thrust', 'thrust'),
    }


def diver(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return three minutes of an underwater float, between 5 and 30 m of depth.

    Its buoyancy follows what its keeper sees of the depth, within 0.2 m.
    """
    mass, density = physics['mass'], physics['density']

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], (u[0] - 20.0 * x[1]) / mass

    def trim(t: float, x: Vector) -> Vector:
        wanted = -17.0 + 8.0 * square(t, 60.0) + 3.0 * math.sin(0.17 * t)
        seen = x[0] + rng.normal(0.0, 0.2)
        return (max(-15.0, min(15.0, 4.0 * (wanted - seen))),)

    start = rng.normal([-10.0, 0.0], [0.5, 0.1])
    truth = integrate(rates, start, [0, 0.0005], physics['seconds'], 0.01, rng, trim, 0.2)
    return {
        'pressure': sampled(
            truth, 'depth', 'pressure', 10.0,
            lambda x: [101325.0 - density * GRAVITY * x[0]], [300.0], rng,
        ),
        'climb': sampled(truth, 'dvl', 'climb', 5.0, column(1), [0.02], rng),
        'sounder': sampled(truth, 'sounder', 'range', 2.0, lambda x: [x[0] + 40.0], [0.08], rng),
        'input': commanded(truth, 'buoyancy', 'thrust'),
    }  # fmt: skip
