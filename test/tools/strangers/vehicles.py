# SPDX-License-Identifier: Apache-2.0
"""What moves from place to place: a rover, a car, a boat, a quadrotor and a balloon."""

from __future__ import annotations

import math

import numpy as np

from .simulation import Array, Readings, Vector, column, commanded, integrate, sampled

GRAVITY = 9.80665


def rover(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return two minutes of a robot on two wheels that follows commands with a lag of 0.25 s.

    It drives curves of both senses, at speeds from -0.4 to 1.6 m/s, and stops now and then.
    """
    radius, track = 0.1, 0.5  # of the wheels and between them, as its odometry believes
    true_radius, true_track = physics['radius'], physics['track']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, omega = x
        return (
            v * math.cos(psi), v * math.sin(psi), (u[0] - v) / 0.25, omega, (u[1] - omega) / 0.25
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        if math.fmod(t, 30.0) > 26.0:
            return 0.0, 0.0
        return 0.6 + math.sin(0.35 * t), 0.7 * math.sin(0.22 * t + 1.0) + 0.3 * math.sin(0.9 * t)

    def wheels(x: Array) -> list[Array]:
        left, right = ((x[2] + side * x[4] * true_track) / true_radius for side in (-0.5, 0.5))
        return [radius * 0.5 * (left + right), radius * (right - left) / track]

    start = rng.normal([0.0, 0.0, 0.0, 0.5, 0.0], [0.1, 0.1, 0.05, 0.1, 0.05])
    truth = integrate(rates, start, [0, 0, 0.02, 0, 0.02], 120.0, 0.002, rng, drive, 0.05)
    return {
        'wheels': sampled(truth, 'odom', 'odometry', 50.0, wheels, [0.02, 0.04], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, 0, x[4], 0, 0, GRAVITY], [0.02] * 6, rng
        ),
        'gnss': sampled(truth, 'fix', 'fix', 5.0, lambda x: [x[0], x[1]], [0.3, 0.3], rng),
        'input': commanded(truth, 'cmd_vel', 'drive'),
    }


def car(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return two minutes of a car with front steering at about 12 m/s, on a winding road.

    The driver wants a turn rate that changes at random, and steers by what speed and wheelbase
    make of it, up to half a radian; the antenna is behind and left of the rear axle.
    """
    base, forward, left = 2.7, physics['antenna_forward'], physics['antenna_left']

    def turn_rate(x: Array) -> Array:
        steering = np.arctan2(base * x[4], x[3]).clip(-0.5, 0.5)
        return np.asarray(x[3] * np.tan(steering) / base)

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, psi, v, wanted, a = x
        steering = max(-0.5, min(0.5, math.atan2(base * wanted, v)))
        turn, easing = v * math.tan(steering) / base, -0.5 * a - 0.03 * (v - 12.0)
        return v * math.cos(psi), v * math.sin(psi), turn, a, -0.5 * wanted, easing

    def antenna(x: Array) -> list[Array]:
        c, s = np.cos(x[2]), np.sin(x[2])
        return [x[0] + c * forward - s * left, x[1] + s * forward + c * left]

    start = rng.normal([0, 0, 0.5, 12.0, 0, 0], [1.0, 1.0, 0.1, 1.0, 0.0, 0.2])
    gyro_bias, bias = rng.normal(0.0, [0.01, 0.1])
    truth = integrate(rates, start, [0, 0, 0, 0, 0.02, 0.3], 120.0, 0.002, rng)
    return {
        'gnss': sampled(truth, 'fix', 'fix', 5.0, antenna, [0.5, 0.5], rng),
        'imu': sampled(
            truth, 'imu', 'imu', 100.0,
            lambda x: [
                0, 0, turn_rate(x) + gyro_bias, x[5] + bias, x[3] * turn_rate(x), GRAVITY
            ],
            [0.01, 0.01, 0.01, 0.1, 0.1, 0.1], rng,
        ),
        'wheels': sampled(truth, 'speed', 'speed', 20.0, column(3), [0.1], rng),
    }  # fmt: skip


def boat(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return five minutes of a boat that meanders at about 3 m/s, in water that may flow.

    Its log measures the speed through the water, its receiver the place above ground.
    """
    current = physics['current']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, v, psi, omega = x
        east, north = v * math.cos(psi) + current, v * math.sin(psi)
        return east, north, -0.05 * (v - 3.0), omega, -0.05 * omega

    start = rng.normal([0.0, 0.0, 3.0, 0.0, 0.0], [1.0, 1.0, 0.3, 0.1, 0.03])
    truth = integrate(rates, start, [0, 0, 0.02, 0, 0.0006], 300.0, 0.005, rng)
    return {
        'gnss': sampled(truth, 'place', 'point', 2.0, lambda x: [x[0], x[1]], [1.0, 1.0], rng),
        'compass': sampled(truth, 'compass', 'compass', 10.0, column(3), [0.03], rng),
        'log': sampled(truth, 'log', 'speed', 5.0, column(2), [0.1], rng),
    }


def quadrotor(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute of a quadrotor in a vertical plane, flown back and forth, up and down.

    Thrust and moment are known; it tilts by up to a third of a radian.
    """
    mass, inertia, drag = physics['mass'], 0.01, physics['drag']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, tilt, vx, vz, turn = x
        lift = u[0] / mass
        return (
            vx, vz, turn, -lift * math.sin(tilt) - drag * vx,
            lift * math.cos(tilt) - GRAVITY - drag * vz, u[1] / inertia,
        )  # fmt: skip

    def fly(t: float, x: Vector) -> Vector:
        px, pz, tilt, vx, vz, turn = x
        ahead = 1.2 * (5.0 * math.sin(0.5 * t) - px) - 1.6 * vx
        up = 4.0 * (3.0 + math.sin(0.8 * t) - pz) - 3.0 * vz
        wanted = max(-0.35, min(0.35, -ahead / GRAVITY))
        return 1.0 * (GRAVITY + up) / math.cos(tilt), 0.01 * (40 * (wanted - tilt) - 10 * turn)

    def altitude(x: Array) -> list[Array]:
        return [x[1] / np.cos(x[2])]

    start = rng.normal([0.0, 3.0, 0.0, 0.0, 0.0, 0.0], [0.1, 0.1, 0.02, 0.1, 0.1, 0.05])
    density = [0, 0, 0, 0.02, 0.02, 0.05]
    truth = integrate(rates, start, density, 60.0, 0.002, rng, fly, 0.01)
    return {
        'beacon': sampled(truth, 'beacon', 'point', 10.0, column(0), [0.05], rng),
        'range': sampled(truth, 'range', 'range', 20.0, altitude, [0.03], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, x[5], 0, 0, 0, 0], [0.02] * 6, rng
        ),
        'input': commanded(truth, 'thrust', 'thrust'),
    }  # fmt: skip


def balloon(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return three minutes of a balloon in gusts, seen by two receivers."""
    start = rng.normal([0.0, 0.0, 2.0, -1.0], [1.0, 1.0, 0.5, 0.5])
    density = [0, 0, 0.05, 0.05]
    truth = integrate(lambda x, u: (x[2], x[3], 0, 0), start, density, 180.0, 0.01, rng)
    return {
        name: sampled(truth, name, 'point', 5.0, lambda x: [x[0], x[1]], [0.5, 0.5], rng)
        for name in ('upper', 'lower')
    }
